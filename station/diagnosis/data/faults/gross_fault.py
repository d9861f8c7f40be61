"""A gross fault: seen directly in the data, before any statistics."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats, Labels

#: A gain counts from so many of its standard errors on, and where at least so many blocks say it.
ACCEPTED_SIGMA, MIN_BLOCKS = 2.0, 2


@dataclass(frozen=True, slots=True)
class BlockGain:
    """What a fault gains on data that it was not fitted to: nats per `per`, or of all where the fault moves means, with
    the standard error over the blocks held out (`held_out_by`); total: nats of all of them; rms before and after in the
    recipe's unit where the fault moves means, else None."""

    per: Literal["sample", "frame"] | None
    held_out_by: str
    log_score: float
    std_error: float
    total: float
    rms_before: float | None = None
    rms_after: float | None = None

    @property
    def accepted(self) -> bool:
        """Whether it gains more than chance would, and leaves no more than there was."""
        worse = self.rms_before is not None and self.rms_after is not None and self.rms_after >= self.rms_before
        return self.log_score > ACCEPTED_SIGMA * self.std_error and not worse


def block_gain(
    scores: Floats,
    counts: Floats,
    per: Literal["sample", "frame"] | None,
    held_out_by: str = "visit",
    rms: tuple[float, float] | None = None,
) -> BlockGain | None:
    """From each block's difference of logarithmic scores (b), summed over its `counts` (b) samples or frames: the
    ratio of both sums, or the sum alone, its standard error by the spread of the blocks. None where too few blocks were
    held out."""
    live = counts > 0
    scores, counts = np.asarray(scores, float)[live], np.asarray(counts, float)[live]
    if len(scores) < MIN_BLOCKS:
        return None
    mean = float(scores.sum() / counts.sum())
    spread = float(np.sqrt(np.sum((scores - mean * counts) ** 2) * len(scores) / (len(scores) - 1)))
    before, after = (None, None) if rms is None else rms
    total, whole = float(scores.sum()), 1.0 if per is None else float(counts.sum())
    return BlockGain(per, held_out_by, total / whole, spread / whole, total, before, after)


def halves_of(blocks: int) -> NDArray[np.intp]:
    """Which half (0, 1) each block belongs to: the fit to one half is judged by the other. Drawn at random, so that no
    half is in step with what recurs every second or every tenth block."""
    return np.asarray(np.random.default_rng(blocks).permutation(blocks) % 2)


def halves(visit: NDArray[np.intp]) -> NDArray[np.intp]:
    """The same for rows, whole visits at a time."""
    place = np.cumsum(np.diff(visit, prepend=visit[:1]) != 0)
    return np.asarray(halves_of(int(place[-1]) + 1)[place])


@dataclass(frozen=True, slots=True)
class FaultParameter:
    """One number of a fault as docs/formats.md names them; a mapping is text and has no deviation."""

    name: str
    axis: str | None
    of: str
    value: float | str
    std: float | None
    unit: str


@dataclass(frozen=True, slots=True)
class GrossFault:
    """A cause that is obvious in the data. nats: how much likelier the data are with it, for the alarm; gain: on
    held-out data, None where not measured."""

    effect: str
    level: str
    numbers: tuple[FaultParameter, ...]
    sentence: str
    nats: float
    indistinguishable_from: tuple[str, ...] = ()
    gain: BlockGain | None = None

    @property
    def rejected(self) -> bool:
        """Whether held-out data contradict it."""
        return self.gain is not None and not self.gain.accepted


def rows_of_units(units: Labels) -> list[slice]:
    """The rows of each unit in a column that is sorted by unit."""
    ends = np.searchsorted(units.code, np.arange(len(units.names) + 1))
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def unit_label(units: Labels, code: int) -> str:
    """A unit as docs/formats.md writes it."""
    return f"unit:{units.names[code]}"
