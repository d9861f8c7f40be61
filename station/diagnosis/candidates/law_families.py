"""Families of laws: the columns of one base, times a course of each law. An offset of each axis takes any course, and
so does the angle of a base that leans or of a nest that turns: what is dear about their columns is done once."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import Candidate, candidates
from station.diagnosis.candidates.course_laws import Course, leaning_courses, offset_courses
from station.diagnosis.candidates.law_forms import curves_by_covariate, laws_of_nests, laws_of_view
from station.diagnosis.candidates.rival_laws import turning_courses
from station.diagnosis.data.residuals import ResidualView
from station.domain.core.types import Floats
from station.model.effects.base_tilt import BaseTilt
from station.model.effects.nest_tilt import NestTilt


class FamilyLaw(NamedTuple):
    """A law of a family: its covariates, joined by *; functions (v, a), or (v, 1) of all columns alike, that the base
    is multiplied by, one after the other; and whether it is one of many close courses."""

    covariates: str
    courses: tuple[Floats, ...]
    close: bool = False


class LawFamily(NamedTuple):
    """columns (v, 3, a) of the base; code (v) of its groups, counted within a unit where they belong to one, and how
    many there are; own: for each level at which the laws are shared, whether it is that of a unit."""

    columns: Floats
    code: NDArray[np.int32]
    groups: int
    own: tuple[bool, ...]
    laws: tuple[FamilyLaw, ...]


def law_families(view: ResidualView) -> Iterator[LawFamily]:
    """Every law that these data can show: of each unit's axes and, of several units, of all alike; and of base and
    nests."""
    visits, one_stimulus, curves = len(view.scene.time_s), view.feels_one_stimulus, curves_by_covariate(view)
    offsets = [
        FamilyLaw(covariates, parts)
        for covariates, parts in laws_of_view(view, curves)
        if not (one_stimulus and "input" in covariates.split("*")) and any((x != x[:1]).any() for x in parts)
    ]
    offsets += _close(course for course in offset_courses(view, curves) if np.ptp(course[1]) > 0)
    own = (True, False) if view.grid.units > 1 else (True,)
    code = np.zeros(visits, np.int32)
    yield LawFamily(np.broadcast_to(np.eye(3), (visits, 3, 3)), code, 1, own, tuple(offsets))
    of_nests = [law for law in laws_of_nests(view, curves) if not (one_stimulus and law[0] == "input")]
    if of_nests:
        yield _of_nests(view, [FamilyLaw(f"{name}*group", parts) for name, parts in of_nests])
    if view.scene.recipe.pose_known:
        leaning = _close(leaning_courses(view, curves))
        turning = [] if one_stimulus else [FamilyLaw(name, (x[:, None],)) for name, x in turning_courses(view, curves)]
        nests = candidates(NestTilt.example(), view)
        for one in (*candidates(BaseTilt.example(), view), *nests):
            laws = turning if one in nests else []
            # Nests that turn alike do about what a base does that leans.
            if one not in nests or len(nests) == 1 or one.of != "common":
                laws = [*laws, *leaning]
            yield _of_base(one, view, laws)


def _of_nests(view: ResidualView, laws: Sequence[FamilyLaw]) -> LawFamily:
    """Offsets of each nest."""
    code, names = view.scene.group("nest")
    return LawFamily(np.broadcast_to(np.eye(3), (len(code), 3, 3)), code, len(names), (False,), tuple(laws))


def _close(courses: Iterator[Course]) -> list[FamilyLaw]:
    return [FamilyLaw(name, (x[:, None],), close=True) for name, x in courses]


def _of_base(one: Candidate, view: ResidualView, laws: Sequence[FamilyLaw]) -> LawFamily:
    code, groups = one.local_codes(view.layout)
    return LawFamily(one.visit, code, groups, (one.pattern == "own",), tuple(laws))
