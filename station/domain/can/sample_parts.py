"""What of a reading comes together: the signals of one message that are in a frame at the same time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.can.sensor_layout import SensorLayout
from station.domain.can.signals import FrameLayout, SignalLayout, adjacent_words, physical, raw
from station.domain.core.types import Array, Floats

#: (reading of the frame, axis, signal).
Cell = tuple[int, int, SignalLayout]


@dataclass(frozen=True, slots=True)
class SamplePart:
    """One part of a reading. selectors: (multiplexer, its values) that show that the part is in a frame."""

    message: FrameLayout
    selectors: tuple[tuple[SignalLayout, tuple[int, ...]], ...]
    cells: tuple[Cell, ...]
    counter: SignalLayout | None

    def present(self, data: NDArray[np.uint8]) -> NDArray[np.bool_] | None:
        """Which frames of the message, payloads (n, w), carry the part; None: all."""
        if not self.selectors:
            return None
        masks = [np.isin(raw(data, signal), np.array(values)) for signal, values in self.selectors]
        return np.asarray(np.logical_and.reduce(masks))

    def readings(self, data: NDArray[np.uint8], count: int) -> Floats:
        """Physical values (n, count, 3) of payloads (n, w); 0 where another part has them."""
        found = np.zeros((len(data), count, 3))
        for place in range(count):
            own = [(axis, signal) for at, axis, signal in self.cells if at == place]
            first, signals = own[0][0], [signal for _, signal in own]
            together = adjacent_words(data, signals) if own[-1][0] - first == len(own) - 1 else None
            if together is not None:
                found[:, place, first : first + len(own)] = physical(together, signals[0])
                continue
            for axis, signal in own:
                found[:, place, axis] = physical(raw(data, signal), signal)
        return found

    def key(self, data: NDArray[np.uint8]) -> Array | None:
        """The counter (n) of the payloads; None where the part has none."""
        return None if self.counter is None else raw(data, self.counter)


def parts_of(layout: SensorLayout) -> tuple[SamplePart, ...]:
    """The parts of a reading, that which gives it its time first."""
    groups: dict[tuple[str, str | None, tuple[int, ...]], list[Cell]] = {}
    for axis, names in enumerate(layout.map.sample.axes):
        for place, name in enumerate(names):
            message, _ = layout.map.sample.place(name)
            signal = layout.signal(name)
            groups.setdefault((message, signal.selector, signal.selected_by), []).append((place, axis, signal))
    ordered = sorted(groups.items(), key=lambda item: item[0][0] != layout.sample.name)
    return tuple(_part(layout, layout.message(name), tuple(cells)) for (name, _, _), cells in ordered)


def _part(layout: SensorLayout, message: FrameLayout, cells: tuple[Cell, ...]) -> SamplePart:
    counter = layout.counter_of(message)
    return SamplePart(message, _selectors(message, cells[0][2]), cells, counter)


def _selectors(message: FrameLayout, signal: SignalLayout) -> tuple[tuple[SignalLayout, tuple[int, ...]], ...]:
    """The multiplexers that select a signal, the nearest first; one may be selected itself."""
    found = []
    while signal.selector is not None:
        selector = message.signal(signal.selector)
        found.append((selector, signal.selected_by))
        signal = selector
    return tuple(found)
