"""Rows 5 and 11: what no data of a recipe can tell apart is given as a set, and the next run it proposes parts it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from diagnosis_rows.figures import Array, Figure, at_least, at_most, share
from diagnosis_rows.trials import Request, Trial, shown

from station.config.recipes import load_recipe
from station.diagnosis.planning.next_run import next_run
from station.diagnosis.planning.proposal import Proposal
from station.diagnosis.results.diagnose import Diagnosis
from station.domain.core.joined_tables import join
from station.domain.core.types import SampleTable
from station.domain.recipe.recipe import Recipe
from tests.blind.bench import WHITE, Floor, Hidden, World, hide, world
from tests.blind.hidden import KNOWN, adds
from tests.blind.inspection import diagnosis_of
from tests.blind.recipes import RATE_HZ, recipe


def _six() -> Recipe:
    whole = load_recipe("six-point")
    return whole.model_copy(update={"device": whole.device.model_copy(update={"rate_hz": RATE_HZ, "lsb": 0.0})})


def _once() -> Recipe:
    return recipe(1)


def _gravity(w: World, rng: Any) -> Array:
    return rng.amplitude(7e-4, (1, 1)) * w.a


def _offset(w: World, rng: Any) -> Array:
    return rng.amplitude(1e-3, (2, 3))[w.nest]


def _remapped(w: World, _rng: Any) -> tuple[Array, Array]:
    return w.feel(device=np.array([0.0, 0.0, np.pi / 2])), np.zeros_like(w.a)


@dataclass(frozen=True)
class Tie:
    """What is hidden, where; the causes that then look exactly alike; none where it resembles a calibration."""

    what: str
    hidden: Hidden
    recipe: Callable[[], Recipe]
    members: frozenset[str]
    units: int = 4
    d: float | None = 16.0


def _tie(what: str, where: Callable[[], Recipe], *members: str, units: int = 4) -> Tie:
    return Tie(f"{what}, {units} units", KNOWN[what], where, frozenset(members), units)


#: A gain or an offset common to all leaves nothing (d = 0): it is hidden at its usual size.
EXACT = (
    _tie("nest-tilt", _once, "nest-tilt", "package-rotation"),
    _tie("nest-tilt", _once, "nest-tilt", "package-rotation", units=1),
    _tie("package-rotation", _once, "nest-tilt", "package-rotation", units=1),
    _tie("base-tilt", _once, "base-tilt", "index-error"),
    _tie("base-tilt", recipe, "base-tilt", "index-error"),
    _tie("index-error", _once, "index-error", "repeatability", units=1),
    _tie("settling", recipe, "settling", "filter-lag", units=1),
    _tie("filter-lag", recipe, "settling", "filter-lag", units=1),
    _tie("quadratic", _six, "quadratic", "asymmetry"),
    _tie("asymmetry", _six, "quadratic", "asymmetry"),
    Tie("axes remapped", _remapped, _once, frozenset({"axis-permutation", "package-rotation"}), d=None),
    Tie("local gravity", adds(_gravity), recipe, frozenset(), d=None),
    Tie("offset of a nest that no unit leaves", adds(_offset), _once, frozenset(), d=None),
    Tie("cubic at six faces", KNOWN["cubic"], _six, frozenset(), d=None),
    Tie("cross-quadratic at six faces", KNOWN["cross-quadratic"], _six, frozenset(), d=None),
)  # fmt: skip


def degenerate(seed: int, sets: int) -> list[Figure]:
    """Row 5."""
    right, wrong = [], []
    for i, tie in enumerate(EXACT):
        for n in range(2 * sets):
            request = Request(tie.what, "white", seed * 10**6 + 900_000 + 100 * i + n, d=tie.d)
            table, truth = hide(tie.recipe(), tie.hidden, request.seed, units=tie.units, d=tie.d)
            t = shown(request, diagnosis_of(tie.recipe(), table), truth)
            if tie.members and not t.alarmed:
                continue
            right.append(_as_it_is(tie, t))
            wrong.append(t.verdict == "named" and not _possible(tie, t))
            if not right[-1]:
                print(f"    {t.miss()}", flush=True)
    return [
        share(f"exact degeneracies given as what they are, {len(EXACT)} kinds", right, lambda p: at_least(p, 0.99)),
        share("  a cause named that it cannot be", wrong, lambda p: at_most(p, 0.005)),
    ]


def _as_it_is(tie: Tie, t: Trial) -> bool:
    return tie.members <= set(t.first) if tie.members else t.verdict == "none"


def _possible(tie: Tie, t: Trial) -> bool:
    """Whether one of those it could be is named first or beside the first."""
    return bool(tie.members & set(t.first))


#: Hidden in one run of the tilt recipe, where each looks like another.
TIED_ONCE = ("nest-tilt", "bias-drift", "offset-temperature", "warm-up", "clamp-creep")


@dataclass
class Taped:
    """Random numbers that are kept; a second pass gets the same ones again."""

    of: Any
    tape: list[Any]
    again: bool = False

    def _next(self, value: Any) -> Any:
        if self.again:
            return self.tape.pop(0)
        self.tape.append(value)
        return value

    def amplitude(self, typical: float, shape: tuple[int, ...]) -> Array:
        """Coefficients; of groups that come new, such as positions, new ones."""
        kept = self._next(None if self.again else self.of.amplitude(typical, shape))
        missing = shape[0] - len(kept)
        return kept if missing <= 0 else np.concatenate([kept, self.of.amplitude(typical, (missing, *shape[1:]))])

    def uniform(self, low: float, high: float) -> float:
        """A shape."""
        return float(self._next(None if self.again else self.of.uniform(low, high)))


@dataclass(frozen=True)
class Parted:
    """What came of a next run: whether one was proposed; the tied causes before and after it, the leader
    first; the chance promised."""

    name: str
    before: tuple[str, ...]
    after: tuple[str, ...] = ()
    promised: float = 0.0
    change: str = ""

    @property
    def proposed(self) -> bool:
        """Whether a run was proposed."""
        return bool(self.change)

    @property
    def leads(self) -> bool:
        """Whether the right one leads."""
        return self.after[:1] == (self.name,)

    @property
    def resolved(self) -> bool:
        """Whether the right one leads and none of those it was tied with is left."""
        return self.leads and not set(self.after) & (set(self.before) - {self.name})


@dataclass(frozen=True)
class Tied:
    """A cause hidden in a campaign that did not tell it from others, which the same units may go through again."""

    name: str
    found: Diagnosis
    before: tuple[str, ...]
    again: Hidden
    table: SampleTable
    measure: Callable[[Recipe, Hidden, int], SampleTable]
    seed: int

    def after(self, proposal: Proposal) -> Parted:
        """What comes of measuring the runs that are proposed, diagnosed together with those there are."""
        more = self.measure(proposal.recipe, self.again, self.seed + 500)
        more = more[more.run > self.table.run.max()]
        after = _set_of(self.name, diagnosis_of(proposal.recipe, join([self.table, more])))
        made = Parted(self.name, self.before, after, proposal.certainty, proposal.change)
        if not made.resolved:
            shown = f"{'/'.join(self.before)} → {proposal.change}, {proposal.certainty:.2f} → {'/'.join(after)}"
            print(f"    {self.name} seed {self.seed}: {shown}", flush=True)
        return made


def tied(name: str, seed: int, d: float, of: Recipe, units: int = 4, floor: Floor = WHITE) -> Tied | None:
    """A cause hidden at strength d; None where the diagnosis does not leave it tied with another."""
    tape: list[Any] = []

    def first(w: World, rng: Any) -> tuple[Array, Array]:
        tape.clear()
        return KNOWN[name](w, Taped(rng, tape))  # type: ignore[arg-type]

    def again(w: World, rng: Any) -> tuple[Array, Array]:
        return KNOWN[name](w, Taped(rng, [*tape], again=True))  # type: ignore[arg-type]

    # A single unit has a single nest.
    here = partial(hide, units=units, floor=floor, made=seed, world_of=partial(world, nests=min(units, 2)))
    table, _ = here(of, first, seed, d=d)
    found = diagnosis_of(of, table)
    before = _set_of(name, found)
    return Tied(name, found, before, again, table, lambda *of: here(*of)[0], seed) if len(before) > 1 else None


def parted(name: str, seed: int, d: float = 12.0) -> Parted | None:
    """Measures one run, then all that is proposed, of the same cause in the same units; None where one run does not
    leave the right cause tied with another."""
    first = tied(name, seed, d, recipe(1))
    return None if first is None else proposed(first)


def proposed(first: Tied) -> Parted:
    """What comes of the run that is proposed."""
    _, proposal = next_run(first.found)
    if proposal is None:
        print(f"    {first.name} seed {first.seed}: {'/'.join(first.before)}: no run proposed", flush=True)
        return Parted(first.name, first.before)
    return first.after(proposal)


def _set_of(name: str, found: Diagnosis) -> tuple[str, ...]:
    sets = [(c.finding.name, *c.finding.indistinguishable_from) for c in found.causes]
    return next((s for s in sets if name in s), ())


def resolved(seed: int, sets: int) -> list[Figure]:
    """Row 11."""
    requested = [(name, 1000 * i + n) for i, name in enumerate(TIED_ONCE) for n in range(2 * sets)]
    tried = [parted(name, seed * 10**6 + 950_000 + n) for name, n in requested]
    ties = [t for t in tried if t is not None]
    return [
        share("next run names the right one of those tied, d = 12", [t.resolved for t in ties], _ninety),
        _promise([t for t in ties if t.proposed]),
        share("  the right one leads", [t.leads for t in ties]),
        share("  it is tied with fewer", [t.proposed and len(t.after) < len(t.before) for t in ties]),
        share("  a run was proposed", [t.proposed for t in ties]),
        share("  tied after one run", [t is not None for t in tried]),
    ]


def _promise(tied: list[Parted]) -> Figure:
    """By how much the promise of a proposed run exceeds what it reaches."""
    gap = np.array([t.promised - t.resolved for t in tied] or [float("nan")])
    mean, error = float(gap.mean()), float(gap.std() / np.sqrt(len(gap)))
    low, high = mean - 1.96 * error, mean + 1.96 * error
    return Figure("  promised − reached", mean, low, high, len(tied), *at_most(mean, 0.05))


def _ninety(p: float) -> tuple[str, bool]:
    return at_least(p, 0.90)
