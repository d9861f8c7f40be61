"""Courses of laws: what a whole axis, a base that leans or a nest that turns does by one function of time,
temperature, drive, the way or the load.

A wide kernel that follows any course has so many numbers that one of few is lost in them; a law of one course is found
if that course is near the true one. What leans or turns has two or three numbers in all, so that courses may lie close.
"""

from collections.abc import Iterator, Mapping
from itertools import chain, combinations_with_replacement, product

import numpy as np

from station.diagnosis.candidates.law_forms import Curves, centred_values
from station.diagnosis.candidates.motion_kernels import remembered, turns_of
from station.diagnosis.candidates.rival_laws import weight_in_nest
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.grid import VisitGrid
from station.domain.core.types import Floats

#: Covariates, joined by *, and a function (v) of them.
Course = tuple[str, Floats]
#: Waves over the range of a covariate, in steps that none falls between, and visits of a run to each; phases within
#: half a wave, as the other half is the same of the other sign.
WAVES, VISITS_A_WAVE, PHASES = np.arange(0.75, 8.1, 0.5), 3, np.arange(6) / 6
#: The same of saws, of what fills and empties at once, which must begin nearer to the true place.
SAWS, VISITS_A_SAW, BEGINS = np.arange(1.4, 5.1, 0.25), 4, np.arange(8) / 8
#: Places in a campaign at which something passes by, and over which shares of it.
PASSES, PASSING = np.arange(0.02, 1.0, 0.04), (0.02, 0.05)
#: Waves of a cable in a radian that it is wound up, and quantiles beyond which it pulls.
CABLE_WAVES, TAUT = (0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0), (0.3, 0.5, 0.7)
#: A turn below this is none, rad; a share of the stimulus from which a loose part slides to the other side.
LEAST_TURN, SLIDES = 1e-6, 0.4
#: Shares of what a load left that are there still at the next visit.
KEPT = (0.4, 0.7, 0.85)


def offset_courses(view: ResidualView, curves: Mapping[str, Curves]) -> Iterator[Course]:
    """Courses that an offset of each axis may take; curves: of each covariate."""
    return chain(_waves_of_view(view, curves), _saws_of_view(view, curves))


def leaning_courses(view: ResidualView, curves: Mapping[str, Curves]) -> Iterator[Course]:
    """Courses by which a base may lean or a nest turn; curves: of each covariate."""
    every = chain(_waves_of_view(view, curves), _curves(curves), _passing(view), _winding(view), _loads(view, curves))
    return ((f"{name}*input", x) for name, x in every if np.ptp(x) > 0)


def _swinging(view: ResidualView, curves: Mapping[str, Curves]) -> Iterator[tuple[str, Floats]]:
    """Time of a run and temperature, as shares of their ranges, where they vary."""
    scene = view.scene
    values = {"time": scene.time_s, "temperature": scene.temperature_degC}
    for name in (name for name in curves if name in values):
        yield name, _share(np.asarray(values[name], float))


def _waves_of_view(view: ResidualView, curves: Mapping[str, Curves]) -> Iterator[Course]:
    """Waves of one phase in time and in temperature."""
    visits = view.grid.slot.shape[2]
    return ((name, x) for name, share in _swinging(view, curves) for x in _waves(share, visits))


def _saws_of_view(view: ResidualView, curves: Mapping[str, Curves]) -> Iterator[Course]:
    """What climbs and falls back at once, with time or with temperature."""
    saws = SAWS[view.grid.slot.shape[2] >= VISITS_A_SAW * SAWS]
    for (name, share), many, begun in product(_swinging(view, curves), saws, BEGINS):
        yield name, centred_values((many * share + begun) % 1.0)


def _waves(share: Floats, visits: int) -> Iterator[Floats]:
    for waves, phase in product(WAVES[visits >= VISITS_A_WAVE * WAVES], PHASES):
        yield centred_values(np.cos(2 * np.pi * waves * share + np.pi * phase))


def _share(x: Floats) -> Floats:
    return np.asarray((x - x.min()) / np.ptp(x))


def _curves(curves: Mapping[str, Curves]) -> Iterator[Course]:
    """Each covariate as it is, and where it bends, switches, or is there alone."""
    for name, of in curves.items():
        yield from ((name, x) for x in (of.plain, *of.bent, *of.switched, *of.bumped, *of.fading))


def _passing(view: ResidualView) -> Iterator[Course]:
    """What passes by once in a campaign, or comes and goes over all its runs."""
    started = view.scene.started_s
    if started is not None and np.ptp(started) > 0:
        clock = started + view.scene.time_s
        share = _share(clock)
        yield from (("time", np.exp(-0.5 * ((share - at) / wide) ** 2)) for at, wide in product(PASSES, PASSING))
        yield from (("time", x) for x in _waves(share, len(np.unique(clock))))


def _winding(view: ResidualView) -> Iterator[Course]:
    """A cable that is wound up, taut from somewhere on, and a gear that goes round."""
    for x in remembered(turns_of(view), view, 1.0).T:
        if np.ptp(x) > LEAST_TURN:
            yield "order", x
            yield from (("order", np.cos(w * x + np.pi * p)) for w, p in product(CABLE_WAVES, PHASES))
            for at in np.quantile(x, TAUT):
                yield from (("order", np.maximum(sign * (x - at), 0.0)) for sign in (1, -1))


def _loads(view: ResidualView, curves: Mapping[str, Curves]) -> Iterator[Course]:
    """How the part lies in its nest, alone or with a covariate, what earlier loads have left, and on which side a loose
    part lay last."""
    felt = np.einsum("vij,vj->iv", view.scene.visits.seat_R, view.nominal_stimulus)
    felt = felt / max(float(np.abs(felt).max()), 1e-300)
    forms = [*weight_in_nest(view), *(x * y for x, y in combinations_with_replacement(felt, 2))]
    yield from (("position", x) for x in forms)
    for name, of in curves.items():
        yield from ((name, of.plain * x) for x in forms)
    for kept in KEPT:
        yield from (("order", x) for x in remembered(felt.T, view, kept).T)
    yield from (("order", x) for x in _last_side(felt.T, view).T)


def _last_side(felt: Floats, view: ResidualView) -> Floats:
    """The side (v, 3) of each axis on which something that slides lies since it last was beyond level."""
    grid = VisitGrid(view.grid.slot, 1)
    side = grid.spread((np.sign(felt) * (np.abs(felt) > SLIDES))[:, None])
    last = np.maximum.accumulate(np.where(side != 0, np.arange(side.shape[2])[:, None], -1), axis=2)
    return grid.gathered(np.where(last >= 0, np.take_along_axis(side, np.maximum(last, 0), axis=2), 0.0))
