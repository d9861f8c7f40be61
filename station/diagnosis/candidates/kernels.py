"""Generic kernels: shapes without a physical story that compete with the causes.

When one of them explains the data better than every cause of the library, something is wrong that nobody has
described yet; its name says on what it depends: one covariate, or two of which a product acts (`time*temperature`).
These are the only columns that are not made by the simulation.
"""

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.polynomial import legendre

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.candidates.dwell_kernels import dwell_kernels
from station.diagnosis.candidates.input_kernels import functions_of_input, products_of_other_axes
from station.diagnosis.candidates.kernel_columns import (
    each_axis,
    grouped_kernel,
    kernel,
    kernels_at,
    levels_that_differ,
    ones,
    own_axis,
    packed_codes,
    scaled,
    steps_before,
    turns_of_nests,
)
from station.diagnosis.candidates.motion_kernels import motion_kernels
from station.diagnosis.candidates.order_kernels import order_kernels
from station.diagnosis.candidates.temperature_kernels import temperature_kernels
from station.diagnosis.candidates.temperature_memory import MIN_TEMPERATURE_RANGE
from station.diagnosis.data.residuals import ResidualView
from station.domain.core.types import Floats
from station.model.effect import Effect
from station.model.effects.base_tilt import BaseTilt
from station.model.effects.disturbed_visit import DisturbedVisit
from station.model.effects.nest_tilt import NestTilt

#: The words of `unknown.depends_on`.
COVARIATES = ("time", "position", "temperature", "input", "dwell-phase", "order", "unit", "group", "motor")
#: The same for what causes are drawn over; the others are drawn over the input or what is read of it.
_ACTS_BY = {
    "dwell": "dwell-phase", "spectrum": "dwell-phase", "order": "order", "step": "order", "run": "order",
    "temperature": "temperature", "temperature-input": "temperature", "temperature-rate": "temperature",
    "time": "time", "since-clamp": "time", "since-power": "time", "position": "position", "visits": "position",
    "motor": "motor", "unit": "unit", "clock": "unit", "group": "group",
}  # fmt: skip
#: Covariates of which products are tried two by two.
FACTORS = ("time", "temperature", "motor", "order", "input", "position")
#: Kernels without columns: ripples faster than the visits, every frequency at once (`search/ripple.py`), and states of
#: units and of nests that change at any visit (`search/hidden_state.py`).
RIPPLE, STATE, NEST_STATE = "time*dwell-phase/ripple", "time/state", "time*input/state"
#: The same of what each arrival stirs up in its own way (`search/restless_arrivals.py`).
ARRIVALS = "dwell-phase/arrivals"
STATES = (STATE, NEST_STATE, ARRIVALS)
#: Kernels of laws of one coefficient an axis (`search/narrow_laws.py`), by what those depend on.
LAWS = tuple(
    f"{words}/law"
    for words in (
        *("time", "temperature", "input", "order", "motor", "position", "order*input", "position*input"),
        *("time*group", "temperature*group", "input*group", "order*group", "motor*group"),
        *("temperature*time", "temperature*motor", "time*motor"),
        *("time*input", "temperature*input", "motor*input", "time*order", "temperature*order", "motor*order"),
        *("temperature*time*input", "temperature*motor*input", "time*motor*input"),
    )
)
#: All kernels.
KERNEL_NAMES = (
    *COVARIATES,
    *("*".join(pair) for pair in combinations(FACTORS, 2)),
    "time/ripple",
    "temperature/ripple",
    "temperature/place",
    "dwell-phase/fading",
    RIPPLE,
    *STATES,
    *LAWS,
)
#: Waves of the slow and of the fast kernel of time, half periods in a run.
HALF_WAVES = (range(1, 4), range(1, 11))
#: Shares of a run after which a third is left of what fades in it.
FADE_SHARES = (0.12, 0.4)
#: Half waves of the kernel over a whole campaign.
CAMPAIGN_WAVES = np.arange(1, 7)
#: Whole waves in a run, in steps that none falls between; of more than MOST_FEW only where a run has so many visits a
#: wave.
SWINGS, MOST_FEW, VISITS_A_WAVE = (1.0, 1.7, 2.5, 3.3, 4.1, 4.9), 2.5, 4
#: From one ripple to the next faster one, waves in a run; visits of the longest run of which they are looked for.
RIPPLE_STEP, MOST_RIPPLED = 0.8, 64


def kernel_candidates(view: ResidualView) -> list[Candidate]:
    """Every kernel that these data can show."""
    still = (
        _time,
        _ripple,
        order_kernels,
        _position,
        temperature_kernels,
        _input,
        _unit,
        _group,
        _motor,
        _products,
        _swinging_gain,
    )
    makers = (*still, motion_kernels, _changing_rig, dwell_kernels)
    found = [candidate for make in makers for candidate in make(view)]
    # In one pose what would change with the input, or from position to position, is an offset on some of the axes.
    same = {"input", "position"} if view.feels_one_stimulus else set[str]()
    return [candidate for candidate in found if not same.intersection(covariates_of(candidate.name))]


def covariates_of(name: str) -> tuple[str, ...]:
    """On what a kernel depends: one word of `depends_on`, or two."""
    return tuple(name.split("/", maxsplit=1)[0].split("*"))


def law_kernel(covariates: tuple[str, ...]) -> str:
    """The kernel of laws that depend on those."""
    return f"{'*'.join(covariates)}/law"


def acts_by(effect: Effect | type[Effect]) -> str:
    """The word of `unknown.depends_on` for what a cause acts by."""
    return _ACTS_BY.get(effect.drawn_over, "input")


def _changing_rig(view: ResidualView) -> Iterator[Candidate]:
    """A nest or a base that turns, and positions that move, with time, temperature or the drive."""
    if not view.scene.recipe.pose_known:
        return
    visits = view.scene.visits
    tilt, base = (view.signature(cause.example(), "common")[0] for cause in (NestTilt, BaseTilt))
    nests = ["nest"] if view.scene.is_recorded("nest") else []
    moved, turned = visits.seat_R.transpose(0, 2, 1), np.ptp(visits.seat_R, axis=0).max(initial=0.0) > 1e-6
    for fade in _fades(view):
        # A part that beds itself, another way each time that it was clamped.
        yield from kernels_at(view, "time*input", tilt * fade[:, None, None], "run")
    for name, functions in _factors(view).items():
        if name in ("order", "input"):
            continue
        x, bent = functions[:, :, :1], functions[:, :, 1:]
        yield from kernels_at(view, f"{name}*input", tilt * x, *nests, "common")
        # The base may lean, and come back.
        yield from kernels_at(view, f"{name}*input", np.concatenate([base * x, base * bent], axis=2), "common")
        if name != "motor":
            # In the nest's frame, as what turns with it, and in the device's, as what is read of it.
            for frame in (moved, np.eye(3))[: 1 + turned]:
                yield kernel(f"{name}*position", "position", view, CauseColumns.in_bank(view, frame * x))


def _time(view: ResidualView) -> Iterator[Candidate]:
    """Waves over the run, slow and fast."""
    share = _shares_of_run(view)
    for waves in HALF_WAVES:
        columns = CauseColumns.in_bank(view, each_axis(np.cos(np.pi * share[:, None] * np.array(waves))))
        for of in levels_that_differ(view, "run", "unit", "common"):
            yield kernel("time", of, view, columns)
    # Some swings in a run, with any phase: few numbers, where a run has few visits.
    for swing in _swings(view):
        columns = CauseColumns.in_bank(view, each_axis(np.concatenate(swing, axis=1)))
        for of in levels_that_differ(view, "run", "unit", "common"):
            yield kernel("time", of, view, columns)
    # What fades in each run from another size: a hand's heat, a part that came in cold.
    for fade in _fades(view):
        yield from kernels_at(view, "time", each_axis(fade[:, None]), "run")
    yield from _campaign(view)


def _shares_of_run(view: ResidualView) -> Floats:
    """How far the longest run has come at each visit (v)."""
    t = view.scene.time_s
    return np.asarray((t - t.min()) / max(float(np.ptp(t)), 1e-9))


def _fades(view: ResidualView) -> list[Floats]:
    """What fades (v) in each run; nothing where no time goes by."""
    share = _shares_of_run(view)
    return [np.exp(-share / fade) for fade in FADE_SHARES] if share.any() else []


def _campaign(view: ResidualView) -> Iterator[Candidate]:
    """Slow waves over all runs of a unit, or of all units, by the clock of the campaign: day and night, a room that
    dries, what ages."""
    started = view.scene.started_s
    if started is None or len(view.scene.group("run")[1]) == view.grid.units:
        return
    clock, unit = started + view.scene.time_s, view.scene.visits.unit.code
    first, last = np.full(view.grid.units, np.inf), np.full(view.grid.units, -np.inf)
    np.minimum.at(first, unit, clock)
    np.maximum.at(last, unit, clock)
    own = (clock - first[unit]) / np.maximum(last - first, 1e-9)[unit]
    for of, share in (("unit", own), ("common", (clock - clock.min()) / max(float(np.ptp(clock)), 1e-9))):
        yield kernel(
            "time", of, view, CauseColumns.in_bank(view, each_axis(np.cos(np.pi * share[:, None] * CAMPAIGN_WAVES)))
        )


def _swings(view: ResidualView) -> Iterator[tuple[Floats, Floats]]:
    """Cosine and sine (v, 1) of some periods in the longest run."""
    t = view.scene.time_s
    share = (t - t.min())[:, None] / max(float(np.ptp(t)), 1e-9)
    most = max(MOST_FEW, view.grid.slot.shape[2] / VISITS_A_WAVE)
    for cycles in (c for c in SWINGS if c <= most):
        yield np.cos(2 * np.pi * cycles * share), np.sin(2 * np.pi * cycles * share)


def _ripple(view: ResidualView) -> Iterator[Candidate]:
    """Waves faster than those, down to two visits each: a conveyor that passes, a compressor that comes on."""
    visits, t = view.grid.slot.shape[2], view.scene.time_s
    slowest = max(c for c in SWINGS if c <= max(MOST_FEW, visits / VISITS_A_WAVE)) + RIPPLE_STEP
    if visits > MOST_RIPPLED or not np.ptp(t):
        return
    share = (t - t.min()) / np.ptp(t)
    for cycles in np.arange(slowest, visits / 2, RIPPLE_STEP):
        wave = np.stack([np.cos(2 * np.pi * cycles * share), np.sin(2 * np.pi * cycles * share)], axis=1)
        yield from kernels_at(view, "time/ripple", each_axis(wave), "run", "common")


def _position(view: ResidualView) -> Iterator[Candidate]:
    """Any offset at each position: along the device's axes, along the nest's, for each unit; a turn in each nest."""
    visits = view.scene.visits
    places = len(visits.position.names)
    yield kernel("position", "position", view, ones(view))
    if np.ptp(visits.seat_R, axis=0).max(initial=0.0) > 1e-6:
        yield kernel("position", "position", view, CauseColumns.in_bank(view, visits.seat_R.transpose(0, 2, 1)))
    nest, nests = view.scene.group("nest")
    code, names = packed_codes(nest * places + visits.position.code)
    # Where a nest has met a position once, a visit that is wrong is the same.
    if len(nests) > 1 and np.bincount(code).min() > 1:
        for turn in turns_of_nests(view):
            yield grouped_kernel("position", "nest-position", code, names, CauseColumns.in_bank(view, turn))
    if view.grid.units > 1:
        code = visits.unit.code * places + visits.position.code
        yield grouped_kernel("position", "unit-position", *packed_codes(code), ones(view))


def _input(view: ResidualView) -> Iterator[Candidate]:
    """Whatever may follow the true vector."""
    a = view.nominal_stimulus
    for columns in functions_of_input(a / np.max(np.linalg.norm(a, axis=1), initial=1e-300)):
        yield from kernels_at(view, "input", columns, "unit", "common")


def _unit(view: ResidualView) -> Iterator[Candidate]:
    """Another offset, another gain and another turn in each run of each unit: it was seated anew."""
    if len(view.scene.group("run")[1]) == view.grid.units:
        return
    a = view.nominal_stimulus
    others = np.concatenate([own_axis(np.roll(a, places, axis=1)) for places in (1, 2)], axis=2)
    for columns in (
        ones(view),
        *(CauseColumns.in_bank(view, x) for x in (own_axis(a), others, *turns_of_nests(view))),
    ):
        yield kernel("unit", "run", view, columns)


def _group(view: ResidualView) -> Iterator[Candidate]:
    """Another offset and another matrix for each station, nest, lot and operator; where a gold is the truth, which may
    stand elsewhere, another turn of each nest."""
    a = view.nominal_stimulus
    matrix = CauseColumns.in_bank(view, np.einsum("ij,vk->vijk", np.eye(3), a).reshape(len(a), 3, 9))
    for of in ("station", "nest", "lot", "operator"):
        if view.scene.is_recorded(of) and len(view.scene.group(of)[1]) > 1:
            yield kernel("group", of, view, ones(view))
            yield kernel("group", of, view, matrix)
            if of == "nest" and view.scene.is_recorded("gold"):
                yield from (
                    kernel("group", of, view, CauseColumns.in_bank(view, turn)) for turn in turns_of_nests(view)
                )


def _motor(view: ResidualView) -> Iterator[Candidate]:
    """Curves of the motors' drive: a bend or two, or waves, as of a resonance."""
    motor = view.scene.motor
    if motor is None or not np.ptp(motor):
        return
    for degree in (3, 7):
        columns = CauseColumns.in_bank(view, each_axis(legendre.legvander(scaled(motor), degree)[:, 1:]))
        for of in levels_that_differ(view, "unit", "common"):
            yield kernel("motor", of, view, columns)


def _products(view: ResidualView) -> Iterator[Candidate]:
    """Products of two covariates, each straight or bent once, on every axis on its own."""
    factor = _factors(view)
    for one, two in combinations(FACTORS, 2):
        if one not in factor or two not in factor:
            continue
        for bends in (1, 2):
            # (v, 3, functions of the one, functions of the other)
            both = factor[one][:, :, :bends, None] * factor[two][:, :, None, :bends]
            functions = both.reshape(len(both), 3, -1)
            columns = CauseColumns.in_bank(
                view, np.einsum("ij,vif->vifj", np.eye(3), functions).reshape(len(both), 3, -1)
            )
            for of in levels_that_differ(view, "unit", "common") if bends == 1 else ("unit",):
                yield kernel(f"{one}*{two}", of, view, columns)
    a = view.nominal_stimulus
    for one in FACTORS:
        if one in factor and (name := f"{one}*input") in KERNEL_NAMES and one != "order":
            # What each axis takes of any, of the product of the two others, or of its own with them.
            for forms in (each_axis(a), *products_of_other_axes(a)):
                columns = CauseColumns.in_bank(view, forms * factor[one][:, :, :1])
                for of in levels_that_differ(view, "unit", "common"):
                    yield kernel(name, of, view, columns)


def _swinging_gain(view: ResidualView) -> Iterator[Candidate]:
    """A gain that swings in time, with any phase."""
    a = view.nominal_stimulus
    for swing in _swings(view) if np.ptp(view.scene.time_s) > 0 else ():
        columns = CauseColumns.in_bank(view, np.concatenate([own_axis(a * wave) for wave in swing], axis=2))
        for of in levels_that_differ(view, "run", "unit", "common"):
            yield kernel("time*input", of, view, columns)


def _factors(view: ResidualView) -> dict[str, Floats]:
    """Functions (v, 3, f) of each covariate that varies, for each axis: Legendre's first two, or what an axis feels
    now and by how much that is another than at the visit before."""
    scene = view.scene
    a = view.nominal_stimulus
    a = a / np.max(np.linalg.norm(a, axis=1), initial=1e-300)
    step = steps_before(view, a)
    plain: dict[str, Floats | None] = {"time": scene.time_s, "motor": scene.motor}
    T = scene.temperature_degC
    plain["temperature"] = None if T is None or np.ptp(T) < MIN_TEMPERATURE_RANGE else T
    found = {
        name: np.repeat(legendre.legvander(scaled(x), 2)[:, None, 1:], 3, axis=1)
        for name, x in plain.items()
        if x is not None and np.ptp(x) > 0
    }
    return {**found, "order": step[:, :, None], "input": np.stack([a, a**2], axis=2)}


def disturbed_readings(view: ResidualView) -> list[Candidate]:
    """A visit whose reading is wrong by anything, not by a turn alone: a part that still moved, or was bumped. Where
    only lengths are known, a length."""
    code, names = view.scene.group("visit")
    if len(names) < 2:
        return []
    anything = np.broadcast_to(np.eye(3), (len(code), 3, 3)).copy()
    if view.grid.k == 1:
        anything = view.keep.transpose(0, 2, 1) / np.sum(view.keep**2, axis=2, keepdims=True)
    return [Candidate(DisturbedVisit.id, None, "visit", "scan", code, names, CauseColumns.in_bank(view, anything))]
