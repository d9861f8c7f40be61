"""Laws of one coefficient an axis that no cause of the library follows, to compare the form of a cause with.

A kernel is wide: it follows anything that depends on its covariate, and pays for every direction of it. A bend, a
threshold, a wave or a product at one value of its constants pays for one, and shows a form that is wrong by little.
What the library's causes do themselves is left out. These columns, like those of the kernels, are not simulated.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, product

import numpy as np

from station.diagnosis.candidates.bank import PER_UNIT_LEVELS, Candidate, candidates
from station.diagnosis.candidates.columns import StopColumns
from station.diagnosis.candidates.kernel_columns import packed_codes
from station.diagnosis.candidates.kernels import acts_by
from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.candidates.shape import has_jump
from station.diagnosis.candidates.temperature_memory import MIN_TEMPERATURE_RANGE, TemperatureMemory
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.evidence import Pattern
from station.domain.core.types import Array, Floats
from station.model.effect import Effect
from station.model.effects.nest_tilt import NestTilt
from station.model.forward import resting_stimulus

#: Quantiles at which a covariate may switch, and at which it may bend; periods of its waves, as shares of its range.
SWITCHES, BENDS, PERIODS = (
    tuple(share / 20 for share in range(2, 19)),
    (0.3, 0.5, 0.7, 0.85),
    (0.2, 0.3, 0.45, 0.65, 0.9),
)
#: Levels that are labels of the visits.
LABELS = ("nest", "station", "lot", "operator")
#: Temperatures at which a jump is tried as a switch.
MAX_SWITCHES = 6
#: Levels of the motors between which something may switch, at most.
MAX_LEVELS = 24
#: Shares of the stimulus below which a reading is dead, or beyond which it rises no more.
KNEES = (0.2, 0.35, 0.5, 0.7)
#: Half waves from no input to the whole, in steps that none falls between.
HALF_WAVES = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0)
#: A step from the stop before that is taken up by play, as a share of the stimulus.
PLAY = 0.3
#: Lags behind the temperature, as shares of a run's duration, and plays in it, as shares of a run's range.
LAGS, THERMAL_PLAYS = (0.1, 0.3, 1.0), (0.2, 0.5)
#: The branch on which each run begins: fallen, in the middle, risen.
BRANCHES = (-1.0, 0.0, 1.0)
#: Visits within which what began at one dies away, and beginnings of one cause that are looked at.
FADES, MOST_STARTS = (1.5, 4.0, 10.0), 4
#: So many times such a fade, what began has died away.
REACH = 3.0
#: What the name of a law begins with; its covariates follow.
PREFIX = "law:"

#: Covariates, joined by *, and the columns (v, 3) of a law; two columns an axis where it has two phases.
Law = tuple[str, tuple[Floats, ...]]


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """Functions (v) of one covariate. plain: a straight line; bent and switched: at one place each; waves: cosine and
    sine of one period each; fading: what is nought at the end, in place of the beginning."""

    plain: Floats
    bent: tuple[Floats, ...]
    switched: tuple[Floats, ...]
    waves: tuple[tuple[Floats, Floats], ...] = ()
    fading: tuple[Floats, ...] = ()


def covariates_of_law(name: str) -> tuple[str, ...]:
    """On what a law depends, as `unknown.depends_on` has it."""
    return tuple(name.removeprefix(PREFIX).split("/")[0].split("*"))


def rival_laws(view: ResidualView, cause: AcceptedCause | None = None, level: str = "unit") -> Iterator[Candidate]:
    """Every law that these data can show, one after the other: for each unit on its own and, of several units, common
    to all; those of the shape and the level of a cause, too: what changes it, what else switches where it jumps."""
    of = level if cause is None else cause.candidate.of
    levels = ("unit", "common") if view.grid.units > 1 else ("unit",)
    found = [_at_levels(view, _laws(view), levels), _tilts(view)]
    if of in LABELS:
        found.append(_at_levels(view, chain(_laws(view), _straight(view)), (of,)))
    elif of == "run" and len(view.scene.group("run")[1]) > view.grid.units:
        found.append(_at_levels(view, _swings(view), (of,)))
    if cause is not None:
        found += [_at_levels(view, _switches_at(cause, view), levels), _changing(cause.candidate, view)]
    return (replace(law, name=f"{law.name}/{i}") for i, law in enumerate(chain.from_iterable(found)))


def _at_levels(view: ResidualView, laws: Iterable[Law], levels: Sequence[str]) -> Iterator[Candidate]:
    """Laws as candidates, shared at each of some levels."""
    for covariates, parts in laws:
        columns = np.concatenate([np.eye(3) * part[:, None, :] for part in parts], axis=2)
        if not np.any(np.ptp(columns, axis=0)):
            continue
        packed = StopColumns.of(columns)
        for of in levels:
            code, names = view.scene.group(of)
            pattern: Pattern = "own" if of in PER_UNIT_LEVELS else "shared"
            word = f"{covariates}*group" if of in LABELS else covariates
            yield Candidate(f"{PREFIX}{word}/{of}", None, of, pattern, code, names, packed)


def _straight(view: ResidualView) -> Iterator[Law]:
    """An offset in proportion to a covariate: of each unit or run a cause of the library, of a nest or a lot none."""
    for name, of in _curves(view):
        yield name, (_each(of.plain),)


def _tilts(view: ResidualView) -> Iterator[Candidate]:
    """A nest that turns with a covariate, straight or at once, whatever else was found."""
    tilt = NestTilt.example()
    if not view.scene.recipe.pose_known:
        return
    for one in candidates(tilt, view):
        for name, of in _curves(view):
            for x in (of.plain, *of.switched[:: len(SWITCHES) // 4]):
                yield _law_of(one, f"{name}*input", StopColumns.of(one.stop * x[:, None, None]))


def _swings(view: ResidualView) -> Iterator[Law]:
    """Waves in time, which have another phase in each run."""
    for name, of in _curves(view):
        if name == "time":
            yield from ((name, (_each(x), _each(y))) for x, y in of.waves)


def _switches_at(jump: AcceptedCause, view: ResidualView) -> Iterator[Law]:
    """Switches of the temperature where it stood as a cause jumps in time: where it only rises they are the same."""
    T, times, previous = view.scene.temperature_degC, view.scene.time_s, view.scene.visits.previous
    one = jump.candidate
    if T is None or np.ptp(T) < MIN_TEMPERATURE_RANGE or not has_jump(one.effect):
        return
    levels = list[Floats]()
    for effect, groups in one.shapes.items():
        jumped = (groups & jump.hit)[one.code] & (previous >= 0)
        at_s: float = effect.at_s  # type: ignore[attr-defined]
        across = jumped & (times[previous] < at_s) & (times >= at_s)
        levels.append((T[previous] + T)[across] / 2)
    found = np.unique(np.round(np.concatenate(levels), 2))
    for i in np.unique(np.linspace(0, len(found) - 1, min(len(found), MAX_SWITCHES)).astype(int)):
        yield "temperature", (_each(_centred(found[i] < T)),)


def _changing(cause: Candidate, view: ResidualView) -> Iterator[Candidate]:
    """A cause that changes with a covariate: a course within the dwells that does, or grows with the move before it;
    and whatever stands still in a dwell, of one size at first."""
    curves = {name: of.plain for name, of in _curves(view)}
    stop, dwell = cause.stop, cause.dwell
    if dwell is not None:
        size = np.linalg.norm(_steps(view), axis=1)
        for name, x in {**curves, "order": size}.items():
            changed = StopColumns.of(stop * x[:, None, None], dwell * x[:, None, None, None])
            law = _law_of(cause, f"dwell-phase*{name}", changed)
            yield from _of_each(law, view)
    elif cause.effect is not None and cause.pattern != "scan":
        word = acts_by(cause.effect)
        # What follows the temperature and changes with it is a cause of the library of another degree.
        for name, x in curves.items():
            if name == word == "temperature":
                continue
            also = stop * x[:, None, None]
            both = "*".join(dict.fromkeys((name, word)))
            yield _law_of(cause, both, StopColumns.of(also))
            yield _law_of(cause, both, StopColumns.of(np.concatenate([stop, also], axis=2)))
        yield from _of_groups(cause, cause.effect, view)


def _of_each(law: Candidate, view: ResidualView) -> Iterator[Candidate]:
    """A law as it is shared, and of each unit on its own where it is not."""
    yield law
    if law.of not in PER_UNIT_LEVELS and view.grid.units > 1:
        code, names = view.scene.group("unit")
        yield replace(law, name=f"{law.name}/unit", of="unit", pattern="own", code=code, names=names)


def _of_groups(cause: Candidate, effect: Effect, view: ResidualView) -> Iterator[Candidate]:
    """A cause that is another in each nest, station, lot or for each operator, of those that the library has for units
    only; of one at each position, another set of them."""
    units = view.scene.visits.unit.code
    for of in LABELS:
        if of in effect.of or not view.scene.is_recorded(of):
            continue
        code, names = view.scene.group(of)
        both = len(np.unique(np.stack([units, code]), axis=1).T)
        if len(names) > 1 and not both == len(names) == view.grid.units:
            law = _law_of(cause, f"{acts_by(effect)}*group", cause.columns)
            if cause.of == "position":
                code, names = packed_codes(code * len(cause.names) + cause.code)
            yield replace(law, name=f"{law.name}/{of}", of=of, pattern="shared", code=code, names=names)


def fading_laws(cause: AcceptedCause, view: ResidualView) -> Iterator[tuple[list[int], list[Candidate]]]:
    """Of some visits that are wrong, or jumps that stay: the groups of one run, these alone, first of all, and what
    begins at one of them and dies away over the visits after it, beside those that it does not reach."""
    one, times = cause.candidate, view.scene.time_s
    stays = has_jump(one.effect)
    if one.pattern != "scan" or not (stays or one.scans_visits):
        return
    begins = {g: e.at_s for e, groups in one.shapes.items() if stays for g in np.flatnonzero(groups).tolist()}  # type: ignore[attr-defined]
    runs, hits = view.scene.group("run")[0], np.flatnonzero(cause.hit).tolist()
    first = {g: int(np.flatnonzero(one.code == g)[0]) for g in hits}
    for group in hits[:MOST_STARTS]:
        rows = one.code == group if stays else runs == runs[first[group]]
        gaps = np.diff(np.unique(times[rows]))
        if not len(gaps):
            continue
        since = times - begins.get(group, times[first[group]])
        after, usual = rows & (since >= 0.0), float(np.median(gaps))
        together = [group] if stays else [g for g in hits if runs[first[g]] == runs[first[group]]]
        courses = [tuple(after if stays else one.code == g for g in together)]
        for fade in FADES:
            course = after * np.exp(-np.maximum(since, 0.0) / (usual * fade))
            apart = [g for g in together if g != group and not 0.0 < since[first[g]] < REACH * usual * fade]
            courses.append((course, *(one.code == g for g in apart)))
        laws = _at_levels(view, (("time", tuple(_each(np.asarray(x, float)) for x in c)) for c in courses), ("common",))
        yield together, [replace(law, name=f"{law.name}/{i}") for i, law in enumerate(laws)]


def _law_of(cause: Candidate, word: str, columns: StopColumns) -> Candidate:
    """Columns as a law that groups as a cause does."""
    name = f"{PREFIX}{word}/{cause.of}"
    return replace(cause, name=name, effect=None, columns=columns, plain=None, own=(), axis_scale=())


def _laws(view: ResidualView) -> Iterator[Law]:
    a, step, curves = _stimulus(view), _steps(view), dict(_curves(view))
    yield from chain(_offsets(curves), _gains(curves, a), _products(curves, a, step), _crosstalk(curves, a))
    yield from _memories(view)
    yield from chain(_products_of_axes(curves, a), _forms_of_input(a), _forms_of_step(a, step))


def _stimulus(view: ResidualView) -> Floats:
    """What each axis feels at each stop (v, 3), as a share of the most."""
    a = resting_stimulus(view.scene, view.active)
    return np.asarray(a / np.max(np.linalg.norm(a, axis=1), initial=1e-300))


def _steps(view: ResidualView) -> Floats:
    """By how much it was another at the stop before (v, 3)."""
    a, previous = _stimulus(view), view.scene.visits.previous
    return np.where(previous[:, None] >= 0, a[previous] - a, 0.0)


def _curves(view: ResidualView) -> Iterator[tuple[str, Curves]]:
    """The curves of each covariate that varies."""
    scene = view.scene
    T, motor = scene.temperature_degC, scene.motor
    if T is not None and np.ptp(T) >= MIN_TEMPERATURE_RANGE:
        yield "temperature", _curves_of(T, _centred(T))
    if np.ptp(scene.time_s) > 0:
        left = _from_zero(scene.time_s.max() - scene.time_s)
        yield "time", replace(_curves_of(scene.time_s, _from_zero(scene.time_s)), fading=(left, left**2))
    if motor is not None and np.ptp(motor) > 0:
        between = np.convolve(np.unique(motor), (0.5, 0.5), "valid")
        chosen = between[np.linspace(0, len(between) - 1, min(len(between), MAX_LEVELS)).astype(int)]
        bent = (np.sqrt(np.abs(motor)), motor, motor**3)
        yield "motor", Curves(_from_zero(motor), bent, tuple(_centred(motor > level) for level in chosen))


def _curves_of(x: Floats, plain: Floats) -> Curves:
    phase = 2 * np.pi * (x - x.min()) / np.ptp(x)
    return Curves(
        plain,
        tuple(np.maximum(sign * (x - np.quantile(x, q)), 0.0) for q in BENDS for sign in (1, -1)),
        tuple(_centred(x > np.quantile(x, q)) for q in SWITCHES),
        tuple((np.cos(phase / p), np.sin(phase / p)) for p in PERIODS),
    )


def _centred(values: Array) -> Floats:
    """Values about their mean, of standard deviation 1."""
    x = np.asarray(values, float)
    return np.asarray((x - np.mean(x)) / max(float(np.std(x)), 1e-300))


def _from_zero(x: Floats) -> Floats:
    """Values of a mean square of 1 that keep their zero: what grows with the time or the drive is nought without it."""
    return np.asarray(x / max(float(np.sqrt(np.mean(x**2))), 1e-300), float)


def _each(x: Floats) -> Floats:
    """A function (v) on every axis alike (v, 3)."""
    return np.repeat(x[:, None], 3, axis=1)


def _offsets(curves: Mapping[str, Curves]) -> Iterator[Law]:
    """An offset that bends, switches or swings, or follows a product."""
    for name, of in curves.items():
        # What switches in time is a cause of the library.
        yield from ((name, (_each(x),)) for x in (*of.bent, *(of.switched if name != "time" else ())))
        yield from ((name, (_each(x), _each(y))) for x, y in of.waves)
    for (one, x), (two, y) in combinations(curves.items(), 2):
        yield f"{one}*{two}", (_each(x.plain * y.plain),)


def _memories(view: ResidualView) -> Iterator[Law]:
    """An offset on another branch while the temperature rises, alone or beside a straight line, or one that lags; what
    follows whether, or how fast, the temperature changes, in another way than in proportion."""
    rate = view.scene.temperature_rate
    if rate is not None and np.ptp(rate) > 0:
        yield from (("temperature", (_each(_centred(form)),)) for form in (np.sign(rate), np.abs(rate), rate**2))
    memory = TemperatureMemory.of(view.scene)
    if memory is None:
        return
    plain = _each(_centred(memory.temperature_degC))
    for play, start in product(THERMAL_PLAYS, BRANCHES):
        branch = _each(memory.branch(play, start))
        yield "temperature", (branch,)
        yield "temperature", (plain, branch)
    for lag in LAGS:
        behind = memory.temperature_degC - memory.lagged(lag)
        yield "temperature", (plain, _each(behind / memory.range_degC))


def _gains(curves: Mapping[str, Curves], a: Floats) -> Iterator[Law]:
    """A gain that does; a gain straight with temperature is a cause of the library."""
    for name, of in curves.items():
        plain = () if name == "temperature" else (of.plain,)
        yield from ((f"{name}*input", (_each(x) * a,)) for x in (*plain, *of.bent, *of.switched))
        yield from ((f"{name}*input", (_each(x) * a, _each(y) * a)) for x, y in of.waves)
    for (one, x), (two, y) in combinations(curves.items(), 2):
        yield f"{one}*{two}*input", (_each(x.plain * y.plain) * a,)


def _products(curves: Mapping[str, Curves], a: Floats, step: Floats) -> Iterator[Law]:
    """What bends the input, or follows the stop before, and changes with a covariate."""
    for name, of in curves.items():
        x = _each(of.plain)
        yield from ((f"{name}*input", (x * form,)) for form in (a**2, np.abs(a), a**3))
        yield from ((f"{name}*order", (x * form,)) for form in (step, np.abs(a) * step))
        yield from ((f"{name}*order", (_each(x) * step,)) for x in of.fading)


def _crosstalk(curves: Mapping[str, Curves], a: Floats) -> Iterator[Law]:
    """What one axis takes of the next two, where it changes with a covariate."""
    for name, of in curves.items():
        for x in (of.plain, of.switched[len(of.switched) // 2]):
            yield f"{name}*input", (_each(x) * np.roll(a, 1, axis=1), _each(x) * np.roll(a, 2, axis=1))


def _products_of_axes(curves: Mapping[str, Curves], a: Floats) -> Iterator[Law]:
    """What one axis takes of the size or the product of others, or of itself and another one, where it changes with a
    covariate."""
    one, two = (np.roll(a, places, axis=1) for places in (1, 2))
    for name, of in curves.items():
        x = _each(of.plain)
        forms = (a * one, a * two), (one * two,), (np.abs(one), np.abs(two))
        yield from ((f"{name}*input", tuple(x * form for form in some)) for some in forms)


def _forms_of_input(a: Floats) -> Iterator[Law]:
    """What is neither a square, a cube nor a size of the input."""
    size = np.abs(a)
    for knee in KNEES:
        yield "input", (np.sign(a) * np.minimum(size, knee),)
        yield "input", (np.maximum(size - knee, 0.0),)
        yield from (("input", (np.maximum(sign * a - knee, 0.0),)) for sign in (1, -1))
    yield from (("input", (np.sin(m * np.pi * a),)) for m in HALF_WAVES)
    yield from (("input", (np.cos(m * np.pi * a),)) for m in HALF_WAVES)
    yield from (("input", (form,)) for form in (np.tanh(4 * a), a**5, a * size))
    one, two = (np.roll(a, places, axis=1) for places in (1, 2))
    yield from (("input", (form(one), form(two))) for form in (np.abs, np.square))
    yield from (("input", (a * form(one), a * form(two))) for form in (np.abs, np.square))


def _forms_of_step(a: Floats, step: Floats) -> Iterator[Law]:
    """What follows the step from the stop before in another way than in proportion."""
    size, way = np.abs(step), np.sign(step) * (np.abs(step) > 1e-6)
    yield from (("order*input", (form * step,)) for form in (np.abs(a), a**2, a))
    yield from (
        ("order", (form,)) for form in (way, way * np.minimum(size, PLAY), way * np.sqrt(size), step * size, size)
    )
    yield "order", (np.roll(step, 1, axis=1), np.roll(step, 2, axis=1))
    move = _each(np.linalg.norm(step, axis=1))
    yield from (("order", (form,)) for form in (move, step * move, way * move))
