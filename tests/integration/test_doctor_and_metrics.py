"""`station doctor` and the figures for Prometheus: right about a healthy station, and about each fault."""

import json
import os
import shutil
import time
from collections import namedtuple
from dataclasses import replace
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families
from starlette.testclient import TestClient

from station.adapters.bus._netlink import Link
from station.cli.app import main
from station.config.settings import load_settings
from station.panel_protocol.queue import WaitingUnit
from station.ports.bus import ErrorCounters
from station.web.app import create_app
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions
from station.wiring import bus_status
from station.wiring.jobs import load_job
from tests.fakes import fixture_run


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    fixture_run.config(tmp_path, golden={"file": "golden.json", "every_h": 8}, database="station.db")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def doctor(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, dict[str, tuple[bool, str]]]:
    """Exit code, and check → (well, said)."""
    with pytest.raises(SystemExit) as ended:
        main(["doctor", "--json", *words])
    report = json.loads(capsys.readouterr().out)
    assert report["well"] == all(c["well"] for c in report["checks"])
    return int(str(ended.value.code)), {c["check"]: (c["well"], c["said"]) for c in report["checks"]}


def test_a_healthy_simulated_station(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fixture_run.config(folder, database="station.db")
    fixture_run.run(folder)
    code, found = doctor(capsys, "--simulate")
    assert code == 0, found
    assert set(found) == {"rights", "clock", "disk", "recipe and DBC", "device map", "key", "golden units"}


def test_each_fault_is_named_with_what_to_do(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10, 9, 1))
    fixture_run.config(
        folder,
        golden={"file": "golden.json", "every_h": 8},
        database="station.db",
        signing_key="no.key",
        bus={"interface": "socketcan", "channel": "can77", "bitrate": 500000},
    )
    code, found = doctor(capsys, "--recipe", "no-such-recipe")
    assert code == 3
    assert "ip link set can77 type can bitrate 500000" in found["bus"][1]
    assert "0.0 GiB free" in found["disk"][1]
    assert "openssl genpkey" in found["key"][1]
    assert "golden register" in found["golden units"][1]
    assert not found["recipe and DBC"][0]
    assert found["rights"][0]


def test_a_controller_with_another_bit_rate_or_a_short_queue_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = {"interface": "socketcan", "channel": "can0", "bitrate": 500000}
    fixture_run.config(folder, database="station.db", bus=bus)
    link = Link(True, "can", "active", ErrorCounters(3, 0), bitrate=250000, queue=10)
    monkeypatch.setattr(bus_status, "query_link", lambda _: link)
    well, printed = doctor(capsys)[1]["bus"]
    assert not well
    assert "can0 runs at 250000 bit/s, but config.yaml sets 500000" in printed
    monkeypatch.setattr(bus_status, "query_link", lambda _: replace(link, bitrate=500000))
    well, printed = doctor(capsys)[1]["bus"]
    assert well
    assert (
        "errors sending 3, receiving 0); its queue holds only 10 frames: `ip link set can0 txqueuelen 1000`" in printed
    )
    monkeypatch.setattr(bus_status, "query_link", lambda _: replace(link, bitrate=500000, can_state="passive"))
    assert "can0 is passive (errors sending 3" in doctor(capsys)[1]["bus"][1]


def test_a_clock_that_was_set_back_is_seen(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fixture_run.run(folder)
    ended_s = time.time()
    monkeypatch.setattr("station.cli._doctor.time.time", lambda: 1.75e9)
    _, found = doctor(capsys, "--simulate")
    assert "behind the newest record" in found["clock"][1]
    # A simulated run of a minute takes a second.
    monkeypatch.setattr("station.cli._doctor.time.time", lambda: ended_s - 60)
    assert doctor(capsys, "--simulate")[1]["clock"][0]


@pytest.fixture
def panel(folder: Path) -> Panel:
    job, _ = load_job("six-point")
    return Panel(
        load_settings(), job.recipe, LaunchOptions(folder / "station.db", "six-point", simulate=True), folder / "a.json"
    )


def figures(client: TestClient) -> dict[str, float]:
    """Every sample by name and labels."""
    text = client.get("/metrics").text
    samples = [s for family in text_string_to_metric_families(text) for s in family.samples]
    return {s.name + "".join(f" {v}" for v in s.labels.values()): s.value for s in samples}


def test_figures_of_an_empty_and_of_a_working_station(folder: Path, panel: Panel) -> None:
    client = TestClient(create_app(panel), client=("127.0.0.1", 1))
    assert client.get("/health").json() == {"status": "ok"}
    assert figures(client)["station_run_active"] == 0
    fixture_run.run(folder, ["SN0001", "SN0002"], faults=("SN0002/stuck-axis:value=2",))
    with pytest.raises(SystemExit):
        main(["golden", "register", "SN0001"])
    panel.queue.put({"A": WaitingUnit("SN0009")})
    found = figures(client)
    assert found["station_attempts PASS"] == found["station_attempts FAIL"] == 1
    assert 20 < found["station_cycle_seconds"] < 60
    assert found["station_recent_kernel_drops"] == 0
    assert found["station_recent_rejected_stops"] > 0
    assert found["station_queue_units"] == 1
    assert 0 <= found["station_golden_age_seconds golden SN0001"] < 600
    assert found["station_golden_problem golden SN0001"] == 0


def test_the_bus_of_a_run_stands_in_the_figures_and_on_the_page(folder: Path, panel: Panel) -> None:
    report = {"name": "can0", "state": "passive", "counters": {"sending": 130, "receiving": 7}}
    with (folder / "station.db.lock").open("w") as lock:
        lock.write(json.dumps({"pid": os.getpid()}))
        lock.flush()
        (folder / "station.db.live.json").write_text(json.dumps({"pid": os.getpid(), "bus": report, "state": {}}))
        found = figures(TestClient(create_app(panel), client=("127.0.0.1", 1)))
        assert panel.screen.shown()["bus"] == report
    assert found["station_bus_errors can0 sending"] == 130
    assert found["station_bus_errors can0 receiving"] == 7
    assert found["station_bus_state can0 passive"] == 1
    assert found["station_bus_state can0 active"] == 0


def test_between_runs_the_kernel_is_asked_for_its_interface(folder: Path) -> None:
    job, _ = load_job("six-point")
    bus = {"interface": "socketcan", "channel": "lo", "bitrate": 500000}
    settings = load_settings(fixture_run.config(folder, bus=bus))
    real = Panel(settings, job.recipe, LaunchOptions(folder / "station.db", "six-point"), folder / "a.json")
    assert real.screen.shown()["bus"] == {"name": "lo", "state": "unknown", "counters": None}
    found = figures(TestClient(create_app(real), client=("127.0.0.1", 1)))
    assert found["station_bus_state lo unknown"] == 1
    assert not [name for name in found if name.startswith("station_bus_errors")]


def test_figures_are_for_this_machine(panel: Panel) -> None:
    assert TestClient(create_app(panel), client=("192.0.2.7", 1)).get("/metrics").status_code == 401


def test_a_log_that_cannot_be_read_is_no_health(folder: Path, panel: Panel) -> None:
    (folder / "station.db").write_bytes(b"no log at all" * 100)
    assert TestClient(create_app(panel)).get("/health").status_code == 503
