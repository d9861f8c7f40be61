"""The runs that a plan chooses from: one more of each kind, and how long it takes."""

from collections.abc import Collection, Iterator
from itertools import combinations, product
from typing import Any

import numpy as np

from station.diagnosis.planning.measured import MeasuredCampaign
from station.diagnosis.planning.plan import PlannedRuns
from station.domain.recipe.blocks import DwellRule, Run
from station.domain.recipe.position import Position, Turn
from station.domain.recipe.recipe import Recipe
from station.model.simulated_line import SimulatedLine
from station.model.timeline import run_timeline

#: How much longer a slow run dwells, and at most for how long, s.
SLOW_FACTOR, SLOWEST_DWELL_S = 10.0, 10.0
#: What an axis feels on a face is none or all of the stimulus, to this share.
FACE_TOLERANCE = 0.02
#: By how much a run may get warmer and cooler, degC, and how many times as fast as the bench warmed at most so far: a
#: rate is no drift and no decay where it changes its sign; one far larger than any measured shows what else it does.
SWINGS_DEGC, SWING_RATIO = (0.5, 1.0, 2.0, 5.0), 3.0
#: Causes that have a run of their own.
FILTER_LAG, BASE_TILT, TEMPERATURE_RATE = "filter-lag", "base-tilt", "temperature-rate"
SECOND_NEST, ANOTHER_NEST = "once more in the next nest", "once more in another nest"


def minutes_of(runs: PlannedRuns) -> float:
    """How long the last run takes, the unit's change and warming included."""
    last = run_timeline(runs.recipe, len(runs.recipe.runs) - 1)
    return (last.duration_s + last.prewarm_s + SimulatedLine().changeover_s) / 60


def run_menu(
    campaign: MeasuredCampaign, now: PlannedRuns, tied: Collection[str] = ()
) -> Iterator[tuple[str, PlannedRuns]]:
    """The campaign with one more run of each kind, the quickest to set up first; tied: ids of causes, some of which
    have a run of their own. Of a rig turned on its floor nothing but a tilt of that feels anything, of a filter that is
    off nothing but its lag."""
    turned, flipped = Turn(axis=(0, 0, 1), angle_deg=180), Turn(axis=(1, 0, 0), angle_deg=180)
    kinds: list[tuple[str, dict[str, Any], dict[str, Turn], bool]] = [
        *([(ANOTHER_NEST if campaign.elsewhere else SECOND_NEST, {}, {}, False)] if campaign.nests > 1 else []),
        ("motors off", {"motors": "off"}, {}, False),
        ("reversed order", {"order": "reversed"}, {}, False),
        ("turned 180° in the seat", {"seating": "turned"}, {"turned": turned}, False),
        ("flipped 180° in the seat", {"seating": "flipped"}, {"flipped": flipped}, False),
        ("10 °C warmer", {"temperature_offset_degC": 10}, {}, False),
        ("reversed and 10 °C warmer", {"order": "reversed", "temperature_offset_degC": 10}, {}, False),
        ("slow", {"order": "reversed"}, {}, True),
        ("slow and 10 °C warmer", {"order": "reversed", "temperature_offset_degC": 10}, {}, True),
        ("warmed up for ten minutes", {"prewarm_s": 600}, {}, False),
        ("flipped and warmed up", {"seating": "flipped", "prewarm_s": 600}, {"flipped": flipped}, False),
        (
            "turned, reversed, 10 °C warmer and warmed up",
            {"seating": "turned", "order": "reversed", "temperature_offset_degC": 10, "prewarm_s": 600},
            {"turned": turned},
            False,
        ),
        ("slow, flipped and warmed up", {"seating": "flipped", "prewarm_s": 600}, {"flipped": flipped}, True),
        (
            "slow, flipped, 10 °C warmer and warmed up",
            {"seating": "flipped", "prewarm_s": 600, "temperature_offset_degC": 10},
            {"flipped": flipped},
            True,
        ),
    ]
    for text, run, seats, slow in kinds:
        # A recipe has one dwell: what follows a slow run is slow too.
        dwell = _slow(now.dwells[0]) if slow else now.dwells[-1]
        if slow and dwell == now.dwells[-1]:
            continue
        words = f"one run {text}" + (f" (dwells of {dwell.time_s:g} s)" if slow else "")
        yield words, now.followed_by(Run(**run), seats, dwell)
    if FILTER_LAG in tied:
        # A swing that each nest has for itself ends in another nest as a lag does with the filter.
        where = " in the same nest" if campaign.nests == 1 else ""
        words = f"one run{where} with the device's filter off"
        yield words, now.followed_by(Run(filter="off"), {}, now.dwells[-1])
    if BASE_TILT in tied and now.recipe.feels_gravity_alone:
        words = "one run with the rig turned 180° on its floor"
        yield words, now.followed_by(Run(base_turn_deg=180), {}, now.dwells[-1])
    if TEMPERATURE_RATE in tied:
        yield from _swings(campaign, now)
    if tilts := _tilts_between_faces(now.recipe):
        words = f"one run with {len(tilts)} tilts between the faces"
        yield words, now.followed_by(Run(), {}, now.dwells[-1], tilts)
        if (slow_dwell := _slow(now.dwells[0])) != now.dwells[-1]:
            yield f"{words}, slow (dwells of {slow_dwell.time_s:g} s)", now.followed_by(Run(), {}, slow_dwell, tilts)


def _swings(campaign: MeasuredCampaign, now: PlannedRuns) -> Iterator[tuple[str, PlannedRuns]]:
    """Runs that are warmed up to their middle and cool again, as they dwell now and slowly."""
    slow_dwell = _slow(now.dwells[0])
    for dwell, words in ((now.dwells[-1], ""), (slow_dwell, f", slow (dwells of {slow_dwell.time_s:g} s)")):
        if words and dwell == now.dwells[-1]:
            continue
        plain = now.followed_by(Run(), {}, dwell)
        length_s = run_timeline(plain.recipe, len(plain.recipe.runs) - 1).duration_s
        wanted = SWING_RATIO * campaign.bench.fastest_degC_s * length_s / np.pi
        size = next((s for s in SWINGS_DEGC if s >= wanted), SWINGS_DEGC[-1])
        yield (
            f"one run warmed by {size:g} °C up to its middle and cooled again{words}",
            now.followed_by(Run(temperature_swing_degC=size), {}, dwell),
        )


def made_for(run: Run) -> str | None:
    """The cause that a run is made for, by id; None where it is for any."""
    if run.filter == "off":
        return FILTER_LAG
    if run.base_turn_deg:
        return BASE_TILT
    return TEMPERATURE_RATE if run.temperature_swing_degC else None


def _slow(rule: DwellRule) -> DwellRule:
    """A dwell that is so much longer; an adaptive one stays."""
    if rule.time_s is None or rule.time_s >= SLOWEST_DWELL_S:
        return rule
    return DwellRule(time_s=min(SLOW_FACTOR * rule.time_s, SLOWEST_DWELL_S))


def _tilts_between_faces(recipe: Recipe) -> tuple[Position, ...]:
    """The twelve positions half-way between two faces, where an axis feels nothing between none and all of the stimulus
    in any position of a recipe; else none, as on a table whose positions state a rate. What bends by the size of the
    input and by its square part only there."""
    if recipe.feels_rotation:
        return ()
    stimulus = np.array([p.matrix().T @ recipe.stimulus(p) for p in recipe.positions]).reshape(-1, 3)
    felt = stimulus / np.linalg.norm(stimulus, axis=1, keepdims=True)
    if not len(felt) or np.any(np.abs(felt * (1 - np.abs(felt))) > FACE_TOLERANCE):
        return ()
    found = []
    for first, second in combinations(range(3), 2):
        for signs in product((1, -1), repeat=2):
            up = np.zeros(3)
            up[[first, second]] = signs
            faces = (f"{'xyz'[i]}-{'up' if up[i] > 0 else 'down'}" for i in (first, second))
            # About the horizontal that is square to it, until it points up.
            turn = Turn(axis=(up[1], -up[0], 0.0), angle_deg=float(np.degrees(np.arccos(up[2] / np.sqrt(2)))))
            found.append(Position(name="-".join(faces), rotate=(turn,)))
    return tuple(found)
