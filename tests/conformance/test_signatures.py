"""Every cause that the simulation can switch on is found again: blind, at its usual size, or it is known to hide.

Made by `station simulate`'s own physics, sample by sample. Every run tries each ninth cause; `make test ALL=1` and
`make blind` try all, a new effect file among them.
"""

import numpy as np
import pytest

from station import plugins
from station.diagnosis.candidates.bank import FLOOR_CAUSES
from station.diagnosis.search.problem import FloorAllowance
from station.model.simulate import SimulationJob, parse_effects, simulate
from tests.blind.inspection import diagnosis_of
from tests.blind.recipes import recipe
from tests.portion import portion

#: Exactly the same as something that is fitted anyway in a recipe without a gold reference (decision record).
HIDDEN = {"local-gravity", "gold-drift"}
#: At its usual size weaker than d = 12 with four units of this noise: simulated three times as large.
FAINT = {"cubic", "cross-quadratic", "bias-drift", "warm-up"}
#: Measured against a data sheet's promise that the blind recipe leaves out.
SHEET = {"quantization", "stuck-bit", "clock-error"}
EFFECTS = plugins.names("station.model.effects")


@pytest.mark.parametrize("name", portion({*EFFECTS} - {*HIDDEN, *FLOOR_CAUSES}, 9))
def test_a_cause_is_found_at_its_usual_size(name: str) -> None:
    rate = {"rate_hz": 100.0} if name in (*SHEET, "motor-tone") else {}
    sheet = recipe().device.model_copy(update={"lsb": 3.8e-6, **rate})
    kind = recipe(1 if rate else 3).model_copy(update={"device": sheet})
    size = 3 * float(plugins.load("station.model.effects", name).parameter.typical)  # type: ignore[attr-defined]
    requested = f"{name}={size}" if name in FAINT else name
    made = simulate(SimulationJob(kind, ("A", "B", "C", "D"), 11, parse_effects((requested,), kind))).table
    found = diagnosis_of(kind, made)
    causes = [(f.effect, f.indistinguishable_from) for f in found.faults] + [
        (c.finding.name, c.finding.indistinguishable_from) for c in found.causes
    ]
    assert causes, found.verdict
    assert any(name == first or name in equal for first, equal in causes)


@pytest.mark.parametrize("name", sorted(HIDDEN))
def test_what_nothing_could_show_is_said_to_be_so(name: str) -> None:
    made = simulate(SimulationJob(recipe(1), ("A", "B"), 12)).table
    assert name in diagnosis_of(recipe(1), made).not_testable


@pytest.mark.parametrize("name", FLOOR_CAUSES)
def test_a_floor_within_the_allowance_is_silent_and_one_beyond_is_named(name: str) -> None:
    allowed = {"repeatability": FloorAllowance().turn, "bias-walk": FloorAllowance().walk}[name]
    for times, named in ((1.0, False), (4.0, True)):
        requested = parse_effects((f"{name}={times * allowed}",), recipe())
        found = diagnosis_of(recipe(), simulate(SimulationJob(recipe(), ("A", "B", "C", "D"), 13, requested)).table)
        assert [c.finding.name for c in found.causes] == ([name] if named else [])
        if named:
            size = found.floor.floor.turn if name == "repeatability" else found.floor.floor.walk
            assert np.isclose(size, times * allowed, rtol=0.15)
