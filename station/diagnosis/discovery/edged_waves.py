"""Waves with edges in place of a smooth one: square waves, sawtooths and pulses, where they explain most.

An edge fixes its own position sharply: a twentieth of a period off, a square wave loses a fifth of its length. So the
best of a grid of frequencies and phases is refined in ever smaller steps.
"""

from collections.abc import Callable, Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from station.diagnosis.data.residuals import ResidualView
from station.domain.core.types import Floats

#: How much of a round each shape stands above, none for the saw.
SHAPES = (0.5, 0.3, None)
#: Phases of the grid, and rounds by which a wave may be ahead at the end of the longest run: another frequency fits it
#: best.
PHASES, DRIFTS = 24, (-0.6, -0.45, -0.3, -0.15, 0.0, 0.15, 0.3, 0.45, 0.6)
#: How often the best is moved to a neighbour, or the steps halved.
MOVES = 6


class EdgedWave(NamedTuple):
    """above: the share of a period that it stands high, none for a sawtooth; drift: periods by which it is ahead at the
    end of the longest run."""

    above: float | None
    drift: float
    phase: float

    def values(self, cycles_hz: float, view: ResidualView) -> Floats:
        """Its mean (v) over each visit, in which an edge may lie."""
        time = view.reduced.fine.time_s
        part = ((cycles_hz + self.drift / max(float(time.max()), 1e-300)) * time + self.phase) % 1
        wave = (
            part - 0.5 if self.above is None else np.where(part < self.above, 1.0, -1.0 if self.above == 0.5 else 0.0)
        )
        return view.reduced.reduce_fine(wave[:, None])[0][:, 0]

    def neighbours(self, drift: float, phase: float) -> Iterator["EdgedWave"]:
        """Those a step away."""
        for one, two in product((-1, 0, 1), repeat=2):
            if one or two:
                yield self._replace(drift=self.drift + one * drift, phase=self.phase + two * phase)


def best_edged_wave(cycles_hz: float, view: ResidualView, worth: Callable[[Floats], float]) -> float:
    """What the best wave with edges near a frequency is worth, where worth is that of its values (v)."""
    return max(_best_of_shape(above, cycles_hz, view, worth) for above in SHAPES)


def _best_of_shape(
    above: float | None, cycles_hz: float, view: ResidualView, worth: Callable[[Floats], float]
) -> float:
    def tried(waves: Iterator[EdgedWave]) -> tuple[float, EdgedWave]:
        return max((worth(w.values(cycles_hz, view)), w) for w in waves)

    # Half a round further a square wave is its own negative.
    phases = PHASES // 2 if above == 0.5 else PHASES
    best, wave = tried(EdgedWave(above, drift, n / PHASES) for drift, n in product(DRIFTS, range(phases)))
    drift, phase = (DRIFTS[1] - DRIFTS[0]) / 2, 0.5 / PHASES
    for _ in range(MOVES):
        value, neighbour = tried(wave.neighbours(drift, phase))
        if value > best:
            best, wave = value, neighbour
        else:
            drift, phase = drift / 2, phase / 2
    return best
