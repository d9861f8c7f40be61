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
    """What the limits said of an attempt then: outcome, offset and matrix (12) or None, checks with their sentences."""

    attempt: str
    serial: str
    outcome: str
    theta: Floats | None
    checks: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class VerdictChange:
    """An attempt whose verdict would be another one, and why."""

    attempt: str
    serial: str
    before: str
    after: str
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class BacktestResult:
    """Of n attempts: how often which verdict became which, those that changed, and by how much coefficients moved.

    moved, in_std (m, 12): new − old, and that over the new standard uncertainty, where both are known.
    """

    verdicts: Counter[tuple[str, str]]
    changes: tuple[VerdictChange, ...]
    moved: Floats
    shift_in_std: Floats

    @staticmethod
    def join(parts: "Sequence[BacktestResult]") -> "BacktestResult":
        """All parts as one."""
        empty = np.zeros((0, 12))
        return BacktestResult(
            sum((p.verdicts for p in parts), Counter()),
            tuple(change for p in parts for change in p.changes),
            np.concatenate([empty, *(p.moved for p in parts)]),
            np.concatenate([empty, *(p.shift_in_std for p in parts)]),
        )


def compare(
    before: Sequence[PreviousResult], after: Sequence[CalibrationResult], *, from_samples: bool
) -> BacktestResult:
    """Attempts as they were and as they come out now; from_samples: raw samples were looked at again."""
    verdicts: Counter[tuple[str, str]] = Counter()
    changes, moved, in_std = [], [], []
    for old, new in zip(before, after, strict=True):
        outcome, reasons = _outcome(old, new, from_samples=from_samples)
        verdicts[old.outcome, outcome] += 1
        if outcome != old.outcome:
            changes.append(VerdictChange(old.attempt, old.serial, old.outcome, outcome, reasons))
        if old.theta is not None and new.calibration is not None:
            shift = np.concatenate([new.calibration.offset, new.calibration.matrix.ravel()]) - old.theta
            std = np.sqrt(np.diagonal(new.calibration.covariance))
            moved.append(shift)
            in_std.append(np.divide(shift, std, out=np.zeros(12), where=std > 0))
    empty = np.zeros((0, 12))
    return BacktestResult(
        verdicts, tuple(changes), np.array(moved) if moved else empty, np.array(in_std) if moved else empty
    )


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


def summary(compared: BacktestResult, recipe: Recipe) -> list[dict[str, object]]:
    """Each coefficient's change over all attempts: root mean square and largest, and the latter in uncertainties."""
    rows: list[dict[str, object]] = []
    for i, name in enumerate(coefficients.NAMES):
        column = compared.moved[:, i]
        rows.append(
            {
                "name": name,
                "unit": coefficients.unit_of(i, recipe.unit),
                "rms_change": float(np.sqrt((column**2).mean())) if len(column) else 0.0,
                "max_change": float(np.abs(column).max(initial=0.0)),
                "max_change_in_std": float(np.abs(compared.shift_in_std[:, i]).max(initial=0.0)),
            }
        )
    return rows
