"""What a station's own results say of its process and of its reproducibility, for the next unit's risks and budget.

The process (JCGM 106, 7.3.4): mean and spread of the newest results of different units. Reproducibility (JCGM 100, 4.2,
Type A): what results of a golden unit differ by when it is measured again, on another day, in another nest, after
reseating, pooled over golden units; less what the budget holds for it already. Other units that come again teach
nothing of it: they come because something was wrong or was changed. Residuals: how much larger than noise those of the
newest different units were, which six of a unit by itself hardly tell.
"""

from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.domain.methods import coefficients, residual_scatter
from station.domain.recipe.blocks import Process
from station.domain.recipe.recipe import Recipe
from station.domain.recipe.reference_block import Reproducibility, ResidualHistory
from station.errors import LogError
from station.messages import Message, Value

#: Fewer units say little of a process, fewer repeats little of reproducibility.
MIN_UNITS, MIN_REPEATS = 20, 5
#: Newest attempts that are learnt from.
NEWEST = 300
#: Lines of the budget that differ from one measurement of a unit to the next; nest tilt does so where the nest changes.
VARYING, BY_NEST = ("noise", "runs"), "nest tilt"


@dataclass(frozen=True, slots=True, eq=False)
class PastResult:
    """One calibration: of which unit, in which nest, on which day (ISO), whether it passed; coefficients (12), and
    standard uncertainties (12) by line of the budget, χ²/ν and ν of the residuals."""

    serial: str
    nest: str
    day: str
    passed: bool
    theta: Floats
    parts: Mapping[str, Floats]
    residuals: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class History:
    """What was learnt. units: that the process was learnt from; repeats: results that give reproducibility, of so many
    golden units, on so many days, in so many nests."""

    process: Process | None
    units: int
    reproducibility: Reproducibility | None
    repeats: int = 0
    golden: int = 0
    days: int = 0
    nests: int = 0
    residuals: ResidualHistory | None = None

    def applied(self, recipe: Recipe) -> Recipe:
        """The recipe with what it leaves open filled in; what it states stands."""
        update: dict[str, Any] = {}
        if recipe.reproducibility is None and self.reproducibility is not None:
            update["reproducibility"] = self.reproducibility
        if recipe.residuals is None and self.residuals is not None:
            update["residuals"] = self.residuals
        if recipe.limits.process is None and self.process is not None:
            update["limits"] = recipe.limits.model_copy(update={"process": self.process})
        return recipe.model_copy(update=update) if update else recipe

    def messages(self, recipe: Recipe) -> tuple[Message, ...]:
        """What risks and budget rest on, for people; recipe: with this history applied."""
        return self._of_process(recipe), self._of_reproducibility(recipe), *self._of_residuals(recipe)

    def _of_process(self, recipe: Recipe) -> Message:
        if recipe.limits.process is None:
            return Message("history-no-process", minimum=MIN_UNITS)
        if recipe.limits.process == self.process:
            return Message("history-process", units=self.units)
        return Message("history-process-stated")

    def _of_reproducibility(self, recipe: Recipe) -> Message:
        again = recipe.reproducibility
        if again is None:
            return Message("history-no-reproducibility", minimum=MIN_REPEATS)
        std: dict[str, Value] = {"offset": again.offset, "gain": again.gain, "cross_axis": again.cross_axis}
        std |= {"unit": recipe.unit, "dof": again.dof}
        if again != self.reproducibility:
            return Message("history-reproducibility-stated", **std)
        made: dict[str, Value] = {"repeats": self.repeats, "units": self.golden}
        return Message("history-reproducibility", **std, **made, days=self.days, nests=self.nests)

    def _of_residuals(self, recipe: Recipe) -> Iterator[Message]:
        left = recipe.residuals
        if left is not None:
            source = "history-residuals" if left == self.residuals else "history-residuals-stated"
            yield Message(source, ratio=left.ratio, dof=left.dof)

    def document(self) -> dict[str, Any]:
        """For the record, bit for bit."""
        models = {"process": self.process, "reproducibility": self.reproducibility, "residuals": self.residuals}
        return {**asdict(self), **{name: m and m.model_dump() for name, m in models.items()}}


NOTHING = History(None, 0, None)


def of_document(document: Mapping[str, Any] | None) -> History:
    """What stands in a record; NOTHING where it has none. Errors: LogError where it is damaged."""
    if not document:
        return NOTHING
    try:
        process, again, left = document["process"], document["reproducibility"], document.get("residuals")
        found = {
            "process": process and Process.model_validate(process),
            "reproducibility": again and Reproducibility.model_validate(again),
            "residuals": left and ResidualHistory.model_validate(left),
        }
        return History(**{**document, **found})
    except (KeyError, TypeError, ValueError) as exc:
        raise LogError("history-damaged", why=" ".join(str(exc).split())) from exc


def learn_history(results: Sequence[PastResult], free: NDArray[np.bool_], golden: Container[str]) -> History:
    """Of results, oldest first. free (12): which coefficients the method estimates; golden: serials of golden units."""
    newest = {r.serial: r for r in results if r.serial not in golden}
    process, units, residuals = None, 0, None
    if len(newest) >= MIN_UNITS:
        process, units = _process([r.theta for r in newest.values()], free), len(newest)
        residuals = _residuals(newest.values())
    again = [r for r in results if r.serial in golden and r.passed]
    groups = [[r for r in again if r.serial == serial] for serial in dict.fromkeys(r.serial for r in again)]
    dof = len(again) - len(groups)
    if dof < MIN_REPEATS:
        return History(process, units, None, residuals=residuals)
    return History(
        process,
        units,
        _reproducibility(groups, dof, free),
        repeats=len(again),
        golden=len(groups),
        days=len({r.day for r in again}),
        nests=len({r.nest for r in again}),
        residuals=residuals,
    )


def _process(thetas: Sequence[Floats], free: NDArray[np.bool_]) -> Process:
    """Of the next unit: the spread is that of these about their mean, which is itself uncertain by the n-th part."""
    off = np.stack(thetas) - coefficients.NOMINAL
    mean, std = off.mean(axis=0), off.std(axis=0, ddof=1) * np.sqrt(1 + 1 / len(off))
    each = tuple((float(m), float(s)) if known and s > 0 else None for m, s, known in zip(mean, std, free, strict=True))
    return Process(each=each, of_results=True, units=len(off))


def _residuals(results: Iterable[PastResult]) -> ResidualHistory | None:
    """None where too few of the units had readings left over."""
    left = [r.residuals for r in results if r.residuals is not None and r.residuals[1] >= 1 and r.residuals[0] > 0]
    if len(left) < MIN_UNITS:
        return None
    ratio, dof = residual_scatter.usual_residuals(left)
    return ResidualHistory(ratio=ratio, dof=dof)


def _reproducibility(groups: Sequence[Sequence[PastResult]], dof: int, free: NDArray[np.bool_]) -> Reproducibility:
    """Pooled over units and over the axes of a kind; degrees of freedom are those of one axis."""
    square = np.zeros(12)
    for group in groups:
        theta = np.stack([r.theta for r in group])
        known = sum(
            (np.mean([r.parts.get(p, np.zeros(12)) ** 2 for r in group], axis=0) for p in VARYING), np.zeros(12)
        )
        tilt = np.mean([r.parts.get(BY_NEST, np.zeros(12)) ** 2 for r in group], axis=0)
        square += ((theta - theta.mean(axis=0)) ** 2).sum(axis=0)
        square -= (len(group) - 1) * known + _changes(Counter(r.nest for r in group)) * tilt
    excess = square / dof
    kinds = {"offset": coefficients.OFFSETS, "gain": coefficients.GAINS, "cross_axis": coefficients.CROSS}
    std = {
        kind: float(np.sqrt(max(excess[own & free].mean(), 0.0))) if (own & free).any() else 0.0
        for kind, own in kinds.items()
    }
    return Reproducibility(**std, dof=dof)


def _changes(nests: Counter[str]) -> float:
    """Of a variance that each nest has by itself, how often it stands in a sum of squares about the mean."""
    n = sum(nests.values())
    return float(n - sum(c**2 for c in nests.values()) / n)
