"""What a changed recipe, method or limits would have made of units that are in the log already."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from station.domain.capture.visit import CapturedVisit
from station.domain.core.types import Floats, Outcome
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.methods import coefficients
from station.domain.recipe.recipe import Recipe

#: Grounds that only raw samples show (`evaluation.quality`): from reduced visits they are taken over as they were.
SAMPLE_CHECKS = frozenset({"stuck", "clipped", "not-still", "scale", "wrong-face"})


@dataclass(frozen=True, slots=True, eq=False)
class PreviousResult:
    """What the limits said of an attempt then: outcome, offset and matrix (12) or None, checks with their
    sentences; whether it was simulated, and judged by what the log had taught."""

    attempt: str
    serial: str
    outcome: str
    theta: Floats | None
    checks: tuple[tuple[str, str], ...]
    simulated: bool
    taught: bool


@dataclass(frozen=True, slots=True)
class VerdictChange:
    """An attempt whose verdict would be another one, and why."""

    attempt: str
    serial: str
    before: str
    after: str
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ComparedAttempts:
    """Attempts as they were and as they come out now, one a row. reasons: of the new verdict;
    simulated, taught: see PreviousResult.

    moved, shift_in_std (n, 12): new − old, and that over the new standard uncertainty; NaN where one of the two came
    to no coefficients.
    """

    attempt: tuple[str, ...]
    serial: tuple[str, ...]
    before: tuple[str, ...]
    after: tuple[str, ...]
    reasons: tuple[tuple[str, ...], ...]
    moved: Floats
    shift_in_std: Floats
    simulated: tuple[bool, ...]
    taught: tuple[bool, ...]


class BacktestTotals:
    """What many portions come to, whatever their number: added up in the order in which they are given."""

    def __init__(self) -> None:
        self.verdicts: Counter[tuple[str, str]] = Counter()
        self.changes: list[VerdictChange] = []
        self.simulated = self.taught = 0
        self._known = 0
        self._squares, self._largest, self._largest_in_std = np.zeros(12), np.zeros(12), np.zeros(12)

    def add(self, part: ComparedAttempts) -> None:
        """One portion more."""
        self.verdicts.update(zip(part.before, part.after, strict=True))
        self.simulated += sum(part.simulated)
        self.taught += sum(part.taught)
        rows = zip(part.attempt, part.serial, part.before, part.after, part.reasons, strict=True)
        self.changes += [VerdictChange(*row) for row in rows if row[2] != row[3]]
        known = np.isfinite(part.moved).all(axis=1)
        self._known += int(known.sum())
        self._squares += (part.moved[known] ** 2).sum(axis=0)
        self._largest = np.maximum(self._largest, np.abs(part.moved[known]).max(axis=0, initial=0.0))
        in_std = np.abs(part.shift_in_std[known]).max(axis=0, initial=0.0)
        self._largest_in_std = np.maximum(self._largest_in_std, in_std)

    def summary(self, unit: str) -> list[dict[str, object]]:
        """Each coefficient's change over all attempts: root mean square and largest, and the latter in uncertainties.
        unit: of the readings."""
        rms = np.sqrt(self._squares / max(self._known, 1))
        return [
            {
                "name": name,
                "unit": coefficients.unit_of(i, unit),
                "rms_change": float(rms[i]),
                "max_change": float(self._largest[i]),
                "max_change_in_std": float(self._largest_in_std[i]),
            }
            for i, name in enumerate(coefficients.NAMES)
        ]


def compare(
    before: Sequence[PreviousResult], after: Sequence[CalibrationResult], *, from_samples: bool
) -> ComparedAttempts:
    """Attempts as they were and as they come out now; from_samples: raw samples were looked at again."""
    outcomes = [_outcome(old, new, from_samples=from_samples) for old, new in zip(before, after, strict=True)]
    moved, in_std = _shifts(before, after)
    return ComparedAttempts(
        tuple(old.attempt for old in before),
        tuple(old.serial for old in before),
        tuple(old.outcome for old in before),
        tuple(outcome for outcome, _ in outcomes),
        tuple(reasons for _, reasons in outcomes),
        moved,
        in_std,
        tuple(old.simulated for old in before),
        tuple(old.taught for old in before),
    )


def _shifts(before: Sequence[PreviousResult], after: Sequence[CalibrationResult]) -> tuple[Floats, Floats]:
    """`ComparedAttempts.moved` and `shift_in_std`."""
    moved, in_std = np.full((len(before), 12), np.nan), np.full((len(before), 12), np.nan)
    pairs = zip(before, after, strict=True)
    both = [
        (i, old.theta, new.calibration)
        for i, (old, new) in enumerate(pairs)
        if old.theta is not None and new.calibration is not None
    ]
    if both:
        rows, old, new = zip(*both, strict=True)
        theta = np.hstack([[one.offset for one in new], [one.matrix.ravel() for one in new]])
        std = np.sqrt([np.diagonal(one.covariance) for one in new])
        shift = theta - np.array(old)
        moved[list(rows)] = shift
        in_std[list(rows)] = np.divide(shift, std, out=np.zeros_like(shift), where=std > 0)
    return moved, in_std


def _outcome(old: PreviousResult, new: CalibrationResult, *, from_samples: bool) -> tuple[str, tuple[str, ...]]:
    """The new verdict with its reasons; from reduced visits those of the samples stand as they were found then."""
    reasons = tuple(r.sentence for r in new.verdict.reasons)
    if from_samples:
        return str(new.verdict.outcome), reasons
    retained = tuple(sentence for check, sentence in old.checks if check in SAMPLE_CHECKS)
    outcome = Outcome.FAIL if retained and new.verdict.outcome is Outcome.PASS else new.verdict.outcome
    return str(outcome), (*retained, *reasons)


def dwells_differ(old: Recipe, new: Recipe) -> bool:
    """Whether the new recipe would cut other dwells out of the frames than the old one did."""
    return (old.settle, old.dwell) != (new.settle, new.dwell)


def recut_dwells(visits: Sequence[CapturedVisit], old: Recipe, new: Recipe) -> list[CapturedVisit]:
    """Visits with the dwells that the new recipe would have taken, as far as there are frames.

    A dwell begins as much earlier or later as its settling is shorter or longer, never before the arrival; it ends
    after the new dwell time, or with the last frame that was kept.
    """
    later_ns = round((new.settle.time_s - old.settle.time_s) * 1e9)
    lasts_ns = None if new.dwell.time_s is None else round(new.dwell.time_s * 1e9)
    made = []
    for v in visits:
        from_ns = max(v.from_ns + later_ns, v.arrived_ns)
        to_ns = v.to_ns if lasts_ns is None else from_ns + lasts_ns
        made.append(replace(v, from_ns=from_ns, to_ns=to_ns))
    return made
