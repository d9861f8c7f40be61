"""Laws of one coefficient an axis outside the library, against which the form of a cause is compared.

A kernel is wide: it follows anything that depends on its covariate, and pays for each of its directions. A bend, a
threshold, a wave or a product at one value of its constants pays for one direction and reveals a slightly wrong form.
What causes of the library do themselves is left out. Like those of the kernels, these columns are not simulated.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import PER_UNIT_LEVELS, Candidate, candidates
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.candidates.dwell_kernels import courses_in_dwells
from station.diagnosis.candidates.kernel_columns import packed_codes
from station.diagnosis.candidates.kernels import acts_by
from station.diagnosis.candidates.law_forms import (
    SWITCHES,
    Curves,
    Law,
    centred_values,
    curves_by_covariate,
    fades_of_campaign,
    laws_of_nests,
    laws_of_view,
    on_every_axis,
    steps_of_stimulus,
)
from station.diagnosis.candidates.motion_laws import functions_of_turns
from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.candidates.shape import has_jump
from station.diagnosis.candidates.temperature_memory import MIN_TEMPERATURE_RANGE
from station.diagnosis.data.reduce import mean_and_contrasts
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.evidence import Pattern
from station.domain.core.types import Floats
from station.model.effect import Effect
from station.model.effects.nest_tilt import NestTilt

#: Levels that are labels of the visits.
LABELS = ("nest", "station", "lot", "operator")
#: Temperatures at which a jump is tried as a switch.
MAX_SWITCHES = 6
#: Parts of a cause that are there as a dwell begins.
DWELL_BEGUN = (0.0, 0.6)
#: Visits within which what began at one dies away, and beginnings of one cause that are looked at.
FADES, MOST_STARTS = (1.5, 4.0, 10.0), 4
#: Visits after which what came at one is gone at once.
STAYS = (2.5, 4.5, 8.5)
#: An axis that feels less than this share of the stimulus lies level.
LEVEL = 1e-6
#: So many times such a fade, what began has died away.
REACH = 3.0
#: What differs by less than this share of a course's range is alike.
ALIKE = 1e-6
#: What the name of a law begins with; its covariates follow.
PREFIX = "law:"


def covariates_of_law(name: str) -> tuple[str, ...]:
    """What a law depends on, as in `unknown.depends_on`."""
    return tuple(name.removeprefix(PREFIX).split("/")[0].split("*"))


def rival_laws(view: ResidualView, cause: AcceptedCause | None = None, level: str = "unit") -> Iterator[Candidate]:
    """Every law that these data can show, one after the other: for each unit and, of several units, common to all. With
    a cause, also laws of its shape and level: what modulates it, and what else switches where it jumps."""
    of = level if cause is None else cause.candidate.of
    levels = ("unit", "common") if view.grid.units > 1 else ("unit",)
    curves = curves_by_covariate(view)
    found = [laws_at_levels(view, laws_of_view(view, curves), levels), _tilts(view, curves)]
    if of in LABELS:
        found.append(laws_at_levels(view, chain(laws_of_view(view, curves), _straight(curves)), (of,)))
    else:
        found.append(laws_at_levels(view, laws_of_nests(view, curves), ("nest",)))
    if of == "run" and len(view.scene.group("run")[1]) > view.grid.units:
        found.append(laws_at_levels(view, _courses_of_run(curves), (of,)))
    if cause is not None:
        found += [laws_at_levels(view, _switches_at(cause, view), levels), _changing(cause.candidate, view, curves)]
    every: Iterable[Candidate] = chain.from_iterable(found)
    if view.feels_one_stimulus:
        every = (law for law in every if "input" not in covariates_of_law(law.name))
    if cause is not None and (single := _single_visits(cause, view)) is not None:
        every = (law for law in every if not _marks_only(law, single, view))
    return (replace(law, name=f"{law.name}/{i}") for i, law in enumerate(every))


def _single_visits(cause: AcceptedCause, view: ResidualView) -> NDArray[np.bool_] | None:
    """The visits (v) at which a cause acts that acts at one visit of each unit at the most; None of any other."""
    c = cause.candidate
    marked = cause.hit[c.code] if c.of == "visit" else cause.hit[c.code] & _marked(c.columns, view)
    often = np.bincount(view.scene.visits.unit.code[marked], minlength=1)
    return marked if often.max() == 1 else None


def _marks_only(law: Candidate, single: NDArray[np.bool_], view: ResidualView) -> bool:
    """Whether a law says nothing but that one of some visits (v) is unlike the others, in each group that has one: that
    is told by what the visit reads alone, and a covariate that is unlike there, too, confirms nothing."""
    marked = _marked(law.columns, view)
    groups = np.unique(law.code[single])
    return all(np.array_equal(marked[on], single[on]) and marked[on].sum() == 1 for on in law.code == groups[:, None])


def _marked(columns: CauseColumns, view: ResidualView) -> NDArray[np.bool_]:
    """The visits (v) at which any course of some columns is not what it is at most visits of the unit."""
    marked = np.zeros(len(columns.still), bool)
    for unit in np.unique(code := view.scene.visits.unit.code):
        of_unit = columns.still[code == unit]
        usual = np.median(of_unit, axis=0)
        marked[code == unit] = np.any(np.abs(of_unit - usual) > ALIKE * np.ptp(of_unit, axis=0), axis=1)
    return marked


def laws_at_levels(view: ResidualView, laws: Iterable[Law], levels: Sequence[str]) -> Iterator[Candidate]:
    """Laws as candidates, shared at each of some levels."""
    for covariates, parts in laws:
        packed = CauseColumns.by_axis(parts)
        if not np.any(packed.still != packed.still[:1]):
            continue
        for of in levels:
            code, names = view.scene.group(of)
            pattern: Pattern = "own" if of in PER_UNIT_LEVELS else "shared"
            word = f"{covariates}*group" if of in LABELS else covariates
            yield Candidate(f"{PREFIX}{word}/{of}", None, of, pattern, code, names, packed)


def _straight(curves: Mapping[str, Curves]) -> Iterator[Law]:
    """An offset in proportion to a covariate: for each unit or run that is a cause of the library, for a nest or a lot
    none."""
    for name, of in curves.items():
        yield name, (on_every_axis(of.plain),)


def _tilts(view: ResidualView, curves: Mapping[str, Curves]) -> Iterator[Candidate]:
    """A nest that turns by any of those courses, whatever else was found."""
    if not view.scene.recipe.pose_known:
        return
    courses = list(turning_courses(view, curves))
    for one in candidates(NestTilt.example(), view):
        for name, x in courses:
            yield law_of_cause(one, name, CauseColumns.of(one.visit * x[:, None, None]))


def turning_courses(view: ResidualView, curves: Mapping[str, Curves]) -> Iterator[tuple[str, Floats]]:
    """Covariates and functions (v) by which a nest may turn: with a covariate, straight or at once, by its own weight,
    or by how the rig turned."""
    yield from (("order*input", x) for x in functions_of_turns(view))
    yield from (("position*input", x) for x in weight_in_nest(view))
    for name, of in curves.items():
        yield from ((f"{name}*input", x) for x in (of.plain, *of.switched[:: len(SWITCHES) // 4]))


def weight_in_nest(view: ResidualView) -> list[Floats]:
    """What each axis of the nest feels (v), its size, and its side where it is slack; none where it is always alike."""
    visits = view.scene.visits
    felt = np.einsum("vij,vj->iv", visits.seat_R, view.nominal_stimulus)
    felt = felt / max(float(np.abs(felt).max()), 1e-300)
    forms = [form for g in felt for form in (g, np.abs(g), np.where(np.abs(g) > LEVEL, np.sign(g), 0.0))]
    return [form for form in forms if np.ptp(form) > LEVEL]


def _courses_of_run(curves: Mapping[str, Curves]) -> Iterator[Law]:
    """What is separate in each run: waves in time, with a phase of their own, and what grows faster than time, or
    later."""
    if (of := curves.get("time")) is not None:
        yield from (("time", (on_every_axis(x), on_every_axis(y))) for x, y in of.waves)
        yield from (("time", (on_every_axis(x),)) for x in (of.plain**2, of.plain**3, *of.bent))


def _switches_at(jump: AcceptedCause, view: ResidualView) -> Iterator[Law]:
    """Switches at the temperature of the moment when a cause jumps in time: where it only rises, the two are the
    same."""
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
        yield "temperature", (on_every_axis(centred_values(found[i] < T)),)


def _changing(cause: Candidate, view: ResidualView, curves: Mapping[str, Curves]) -> Iterator[Candidate]:
    """A cause that varies with a covariate: a course within the dwells that does, or grows with the move before it; and
    whatever is constant within a dwell, at first of one size."""
    plain = [(name, of.plain) for name, of in curves.items()]
    visit, dwell = cause.visit, cause.dwell
    if dwell is not None:
        size = np.linalg.norm(steps_of_stimulus(view), axis=1)
        for name, x in (*plain, ("order", size)):
            changed = CauseColumns.of(visit * x[:, None, None], dwell * x[:, None, None, None])
            law = law_of_cause(cause, f"dwell-phase*{name}", changed)
            yield from _of_each(law, view)
        if cause.effect is not None and acts_by(cause.effect) == "dwell-phase":
            yield from (law_of_cause(cause, "dwell-phase", columns) for columns in courses_in_dwells(view))
    elif cause.effect is not None and cause.pattern != "scan":
        word = acts_by(cause.effect)
        # What follows the temperature and changes with it is a cause of the library of another degree.
        for name, x in (*plain, *(("time", x) for x in fades_of_campaign(view))):
            if name == word == "temperature":
                continue
            alone, also = (visit * of[:, None, None] for of in _within_groups(cause, x))
            both = "*".join(dict.fromkeys((name, word)))
            yield law_of_cause(cause, both, CauseColumns.of(alone))
            yield law_of_cause(cause, both, CauseColumns.of(np.concatenate([visit, also], axis=2)))
        yield from _of_groups(cause, cause.effect, view)


def _within_groups(cause: Candidate, x: Floats) -> tuple[Floats, Floats]:
    """A covariate (v) as it changes what alone is there, and what something else is there beside. Where each group has
    a coefficient of its own, how much of it a group has is no change: in each it is of one size, and about 0."""
    if cause.pattern != "own":
        return x, x
    group = np.unique(cause.code, return_inverse=True)[1]
    mean, square = (np.bincount(group, y) / np.bincount(group) for y in (x, x**2))
    return x / np.sqrt(np.maximum(square, 1e-300))[group], x - mean[group]


def _of_each(law: Candidate, view: ResidualView) -> Iterator[Candidate]:
    """A law as it is shared, and for each unit separately where it is not."""
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
            law = law_of_cause(cause, f"{acts_by(effect)}*group", cause.columns)
            if cause.of == "position":
                code, names = packed_codes(code * len(cause.names) + cause.code)
            yield replace(law, name=f"{law.name}/{of}", of=of, pattern="shared", code=code, names=names)


def laws_within_dwells(cause: Candidate, view: ResidualView) -> list[Candidate]:
    """A cause that stands still in each dwell as it is in the blocks, first of all, and what comes on from block to
    block and had none or a part of its size at first; none where nothing could show it, or of a cause that follows time
    or temperature, which go on within a long dwell."""
    count = view.reduced.count
    if cause.moving or cause.effect is None or cause.pattern == "scan" or not np.any(count[:, 1:]):
        return []
    if acts_by(cause.effect) in ("time", "temperature"):
        return []
    late = np.linspace(1.0, 0.0, count.shape[1]) ** 2
    word, found = f"dwell-phase*{acts_by(cause.effect)}", list[Candidate]()
    for begun in (1.0, *DWELL_BEGUN):
        rows = cause.visit[:, None] * (1.0 - (1.0 - begun) * late)[:, None, None]
        law = law_of_cause(cause, word, CauseColumns.of(*mean_and_contrasts(rows, count)))
        found.append(replace(law, name=f"{law.name}/{begun:g}"))
    return found


def fading_laws(cause: AcceptedCause, view: ResidualView) -> Iterator[tuple[list[int], list[Candidate]]]:
    """Of some visits that are wrong, or jumps that stay: the groups of one run, these alone, first of all, and what
    begins at one of them and dies away, or ends, over the visits after it, beside those that it does not reach."""
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
        ends = [(after * np.exp(-np.maximum(since, 0.0) / (usual * fade)), REACH * usual * fade) for fade in FADES]
        ends += [(after & (since < usual * stay), usual * stay) for stay in STAYS]
        for course, reach in ends:
            apart = [g for g in together if g != group and not 0.0 < since[first[g]] < reach]
            courses.append((course, *(one.code == g for g in apart)))
        laws = laws_at_levels(
            view, (("time", tuple(on_every_axis(np.asarray(x, float)) for x in c)) for c in courses), ("common",)
        )
        yield together, [replace(law, name=f"{law.name}/{i}") for i, law in enumerate(laws)]


def law_of_cause(cause: Candidate, word: str, columns: CauseColumns) -> Candidate:
    """Columns as a law with the groups of a cause."""
    name = f"{PREFIX}{word}/{cause.of}"
    return replace(cause, name=name, effect=None, columns=columns, plain=None, own=(), axis_scale=())
