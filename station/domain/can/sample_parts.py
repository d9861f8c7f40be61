"""What of a reading comes together: the signals of one message that are in a frame at the same time."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.can.signals import FrameLayout, SignalLayout, are_adjacent, physical, raw, raw_words
from station.domain.core.types import Array, Floats

#: Which of the message's values: reading of the frame · 3 + axis.
Cell = tuple[int, SignalLayout]


@dataclass(frozen=True, slots=True)
class SamplePart:
    """One part of a reading. selectors: (multiplexer, its values) that show that the part is in a frame; cells by their
    number; stretches: the same, those together that are decoded at once."""

    message: FrameLayout
    selectors: tuple[tuple[SignalLayout, tuple[int, ...]], ...]
    cells: tuple[Cell, ...]
    stretches: tuple[tuple[Cell, ...], ...]
    counter: SignalLayout | None

    def present(self, data: NDArray[np.uint8]) -> NDArray[np.bool_] | None:
        """Which frames of the message, payloads (n, w), carry the part; None: all."""
        if not self.selectors:
            return None
        masks = [np.isin(raw(data, signal), np.array(values)) for signal, values in self.selectors]
        return np.asarray(np.logical_and.reduce(masks))

    def readings(self, data: NDArray[np.uint8], count: int) -> Floats:
        """Physical values (n, count, 3) of payloads (n, w); 0 where another part has them."""
        found = np.zeros((len(data), 3 * count))
        for stretch in self.stretches:
            cell, signal = stretch[0]
            if len(stretch) > 1:
                found[:, cell : cell + len(stretch)] = physical(raw_words(data, signal, len(stretch)), signal)
            else:
                found[:, cell] = physical(raw(data, signal), signal)
        return found.reshape(-1, count, 3)

    def key(self, data: NDArray[np.uint8]) -> Array | None:
        """The counter (n) of the payloads; None where the part has none."""
        return None if self.counter is None else raw(data, self.counter)


def part_of(message: FrameLayout, cells: Iterable[Cell], counter: SignalLayout | None) -> SamplePart:
    """The part that cells of one message make, all of them selected alike."""
    ordered = tuple(sorted(cells, key=lambda cell: cell[0]))
    return SamplePart(message, _selectors(message, ordered[0][1]), ordered, _stretches(ordered), counter)


def _stretches(cells: tuple[Cell, ...]) -> tuple[tuple[Cell, ...], ...]:
    found: list[list[Cell]] = []
    for cell in cells:
        last = found[-1] if found else []
        if last and cell[0] == last[-1][0] + 1 and are_adjacent([signal for _, signal in (*last, cell)]):
            last.append(cell)
        else:
            found.append([cell])
    return tuple(map(tuple, found))


def _selectors(message: FrameLayout, signal: SignalLayout) -> tuple[tuple[SignalLayout, tuple[int, ...]], ...]:
    """The multiplexers that select a signal, the nearest first; one may be selected itself."""
    found = []
    while signal.selector is not None:
        selector = message.signal(signal.selector)
        found.append((selector, signal.selected_by))
        signal = selector
    return tuple(found)
