"""What the bus complains of: recorded at each stop, and the end of the run where the controller went bus-off."""

from pathlib import Path

import pytest

from station.domain.core.types import Outcome
from station.domain.run.progress import VisitDone
from station.errors import BusFault, DeviceRefused, DeviceSilent
from station.service.bus_errors import with_bus_state
from tests.fakes import fixture_run
from tests.fakes.bus_trouble import troubled
from tests.fakes.fixture_run import Ran


def printed(ran: Ran, serial: str = "SN0001") -> list[str]:
    return [text for v in ran.life(serial)["visits"] for text in v["statistics"]["bus_errors"]]


def test_error_frames_stand_in_the_statistics_of_every_nest(tmp_path: Path) -> None:
    every_50_ms = [(i / 20, "error-passive") for i in range(80, 105)]
    ran = fixture_run.run(tmp_path, units=2, wrap=troubled(*every_50_ms, (4.5, "no-acknowledge")))
    assert {r.outcome for r in ran.results.values()} == {Outcome.PASS}
    for serial in ran.results:
        shown = printed(ran, serial)
        assert any("error passive while receiving" in text for text in shown)
    clean = fixture_run.run(tmp_path, ["SN0009"])
    assert printed(clean, "SN0009") == []


@pytest.mark.parametrize("at_s", [1.0, 2.5, 6.0, 7.3])
def test_bus_off_at_any_moment_of_the_tumble_ends_the_run_and_names_the_bus(tmp_path: Path, at_s: float) -> None:
    ran = fixture_run.run(tmp_path, units=2, wrap=troubled((at_s, "bus-off")))
    assert isinstance(ran.fault, BusFault)
    assert {r.outcome for r in ran.results.values()} == {Outcome.ERROR}
    for serial, result in ran.results.items():
        assert "simulated: the controller is bus-off" in result.reasons[0].sentence
        assert ran.life(serial)["outcome"] == "ERROR"
        assert ran.memory(serial) == {}
    assert len(ran.of(VisitDone)) < 8
    assert ran.parked


def test_a_controller_that_came_back_at_once_is_only_recorded(tmp_path: Path) -> None:
    plan = [(i / 10, kind) for i in range(40, 50) for kind in ("bus-off", "restarted")]
    ran = fixture_run.run(tmp_path, wrap=troubled(*plan))
    assert ran.results["SN0001"].outcome is Outcome.PASS
    assert any("restarted after bus-off" in text for text in printed(ran))


class Bus:
    """A bus in a given state."""

    name = "can0"

    def __init__(self, state: str) -> None:
        self._state = state

    def state(self) -> str:
        return self._state


@pytest.mark.parametrize(
    ("state", "remedy"), [("bus-off", ": check bit rate"), ("passive", ", no node ack"), ("down", ": bring it up")]
)
def test_a_silence_that_is_the_bus_s_doing_says_so(state: str, remedy: str) -> None:
    shown = with_bus_state(DeviceSilent("node 5 did not answer."), Bus(state))  # type: ignore[arg-type]
    assert shown.sentence.startswith(f"node 5 did not answer. can0 is {state}{remedy}")


def test_any_other_fault_and_any_good_bus_leave_the_sentence_alone() -> None:
    silent, refused = DeviceSilent("node 5 did not answer."), DeviceRefused("value too high", code=0x06090030)
    assert with_bus_state(silent, Bus("active")) is silent  # type: ignore[arg-type]
    assert with_bus_state(refused, Bus("bus-off")) is refused  # type: ignore[arg-type]
