"""What a run tells the page, and the pace at which a simulated one can be watched."""

import json
import time
from pathlib import Path
from typing import Any

import pytest

from station.adapters.bus.simulated import SimulatedBus
from station.adapters.clock import VirtualClock
from station.cli._pacing import RealTimePacer
from station.domain.core.types import NestAssignment
from station.domain.run.progress import LoadStarted, VisitStarted
from station.messages import Message
from station.panel_protocol.live_state import LiveStateWriter
from station.service.stop_request import StopRequest
from station.wiring.jobs import load_job

BEGUN = LoadStarted((NestAssignment("SN1", "A", 17),), 8, 25.0)


def test_the_live_file_holds_the_state_after_every_event(tmp_path: Path) -> None:
    job, _ = load_job("six-point")
    live = LiveStateWriter(tmp_path / "s.db", job.recipe, {"operator": "anna"}, print)
    for event in (BEGUN, VisitStarted(1, 6, "z-up")):
        live.event(event)
    shown = json.loads((tmp_path / "s.db.live.json").read_text())
    assert (shown["schema"], shown["operator"], shown["unit"]) == ("station.live/1", "anna", "g")
    assert (shown["state"]["position"], shown["state"]["following"]) == ("z-up", "z-down")
    assert len(shown["state"]["visits"]) == 8
    assert [c["kind"] for c in shown["cells"]] == ["identify", *["stop"] * 6, "write", "verify"]
    assert (shown["state"]["at"], shown["cell"], shown["cells"][1]["true"]) == (0, 1, [0.0, 0.0, 1.0])
    assert [p.name for p in tmp_path.iterdir()] == ["s.db.live.json"], "nothing half written is left"


def test_the_live_file_tells_the_state_of_the_bus(tmp_path: Path) -> None:
    job, _ = load_job("six-point")
    bus = SimulatedBus(VirtualClock(), "sim0")
    bus.break_wire("cable-out")
    LiveStateWriter(tmp_path / "s.db", job.recipe, {}, print, bus).event(BEGUN)
    shown = json.loads((tmp_path / "s.db.live.json").read_text())["bus"]
    assert shown == {"name": "sim0", "state": "passive", "counters": {"sending": 128, "receiving": 0}}
    bus.close()


def test_a_view_that_cannot_be_written_is_said_once_and_stops_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job, _ = load_job("six-point")
    live = LiveStateWriter(tmp_path / "none" / "s.db", job.recipe, {}, print)
    live.event(BEGUN)
    live.event(BEGUN)
    assert capsys.readouterr().out.count("cannot be written") == 1


def test_a_paced_run_waits_for_real_time_and_a_stop_ends_the_wait() -> None:
    virtual = [0.0]
    stop = StopRequest()
    pace = RealTimePacer(100.0, lambda: virtual[0], stop)
    virtual[0] = 5.0
    began = time.monotonic()
    pace.keep()
    assert 0.045 < time.monotonic() - began < 5
    virtual[0] = 1e6
    stop.request()
    pace.keep()
    assert time.monotonic() - began < 5


def test_a_seating_turns_the_picture_of_the_same_position(tmp_path: Path) -> None:
    job, _ = load_job("tilt-24")
    live = LiveStateWriter(tmp_path / "s.db", job.recipe, {}, print)
    live.event(BEGUN)
    shown = json.loads((tmp_path / "s.db.live.json").read_text())
    first, again = [c for c in shown["cells"] if (c["kind"], c["name"]) == ("stop", "x-045")][:2]
    assert first["pose"] != again["pose"], "turned in its nest, the unit shows another face"


def test_a_question_bears_a_mark_and_the_time_it_takes_is_no_progress(tmp_path: Path) -> None:
    job, _ = load_job("six-point")
    live = LiveStateWriter(tmp_path / "s.db", job.recipe, {}, print)
    live.event(BEGUN)

    def state() -> dict[str, Any]:
        return dict(json.loads((tmp_path / "s.db.live.json").read_text())["state"])

    began_s = state()["began_s"]
    turn = Message("load-units", units="SN1 (A)")
    mark = live.ask(turn)
    assert (state()["confirm"], state()["question"]) == ({"id": "load-units", "units": "SN1 (A)"}, mark)
    assert live.ask(turn) != mark, "an old answer does not fit a new question"
    live.clear_question(40.0)
    assert (state()["confirm"], state()["question"], state()["began_s"]) == (None, "", began_s + 40.0)


def test_time_that_a_person_takes_is_not_made_up_for() -> None:
    virtual = [0.0]
    pace = RealTimePacer(100.0, lambda: virtual[0], StopRequest())
    pace.skip(-3600.0)  # as if the start lay an hour back
    virtual[0] = 5.0
    pace.skip(3600.0)
    began = time.monotonic()
    pace.keep()
    assert time.monotonic() - began > 0.03
