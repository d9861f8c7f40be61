"""A run on a real interface that is flooded, cut or full of errors: the record tells the truth, nothing bad is used."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from vcan_harness import fixture, programs
from vcan_harness.command import run
from vcan_harness.interface import Interface, Link, create_vcan
from vcan_harness.programs import Candump, Logged, cansend
from vcan_harness.waiting import until

from station.domain.core.types import Outcome
from station.domain.records.stored_attempt import result
from station.domain.run.progress import Event, Identified, LiveReading, VisitRejected, VisitStarted
from station.errors import BusFault
from station.wiring.bench import Bench

NODE, SERIAL = 0x11, "SN0042"
FLOOD = ("-g", "0", "-n", "2000", "-I", f"{0x180 + NODE:X}", "-L", "8", "-D", "i")
#: The least buffer of config.yaml: some 170 frames.
SMALL_BUFFER = {"receive_buffer_bytes": 65_536}
ERROR_FLAG, CONTROLLER, BUS_OFF = 0x2000_0000, 0x004, 0x040
PASSIVE = bytes([0, 0x10, 0, 0, 0, 0, 0, 130])


class During:
    """Does something once, in the first dwell at a position."""

    def __init__(self, **actions: Callable[[], object]) -> None:
        self._deeds = {name.replace("_", "-"): deed for name, deed in actions.items()}
        self._position = ""

    def __call__(self, event: Event, _bench: Bench) -> None:
        if isinstance(event, VisitStarted):
            self._position = event.position
        if isinstance(event, LiveReading) and self._position in self._deeds:
            self._deeds.pop(self._position)()


def flood(interface: Interface) -> None:
    """cangen as fast as it can, on the identifier of the unit's own readings, to its end."""
    with programs.start_cangen(interface, *FLOOD) as running:
        assert running.wait(timeout=60) == 0


@dataclass(frozen=True)
class Disturbed:
    """A run with a flood at x-up and an error frame at y-down. truth: the device's matrix and offset."""

    folder: Path
    ran: fixture.Ran
    observed: list[Logged]
    truth: tuple[Any, Any]


@pytest.fixture(scope="module")
def disturbed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Disturbed]:
    """One run serves all tests of a disturbed dwell."""
    folder = tmp_path_factory.mktemp("disturbed")
    vcan = create_vcan("vcanbad")
    try:
        candump = Candump(vcan, folder / "candump.log", "-r", "8000000")
        during = During(
            x_up=lambda: flood(vcan), y_down=lambda: cansend(vcan, ERROR_FLAG | CONTROLLER, PASSIVE)
        )  # fmt: skip
        with (
            fixture.Served(vcan, (NODE,), (SERIAL,), flash_s=0.05) as served,
            fixture.opened(folder, vcan, (NODE,), bus=SMALL_BUFFER, positioner=fixture.DRIVEN) as bench,
        ):
            ran = fixture.run(bench, [SERIAL], served.turn, during)
        body = served.bodies[SERIAL]
        yield Disturbed(folder, ran, candump.stop(), (body.matrix, body.offset))
    finally:
        vcan.delete()


def test_the_drop_counter_tells_the_truth_about_a_flood(disturbed: Disturbed) -> None:
    (flooded,) = [v for v in fixture.visits(disturbed.folder, SERIAL) if v.statistics["kernel_drops"]]
    inside = range(flooded.from_ns // 1000, flooded.to_ns // 1000)
    ids = (0x180 + NODE, 0x280 + NODE)
    sent = [f for f in disturbed.observed if f.time_us in inside and f.can_id in ids]
    received = [row for row in fixture.rows(flooded.frames) if row[0] in inside]
    assert sum(f.can_id == ids[0] and f.data[6:] == b"\0\0" for f in sent) > 1900, "candump saw the flood whole"
    assert flooded.statistics["kernel_drops"] == len(sent) - len(received) > 1500


def test_a_flooded_dwell_is_measured_again_and_never_used(disturbed: Disturbed) -> None:
    r = disturbed.ran.results[SERIAL]
    rejected = [e for e in disturbed.ran.events if isinstance(e, VisitRejected)]
    (flooded,) = [e for e in rejected if "kernel-drops" in {reason.check for reason in e.reasons}]
    assert (flooded.position, flooded.again) == ("x-up", True)
    assert r.reasons == ()
    assert (r.outcome, r.written, r.verified) == (Outcome.PASS, True, True)
    at_x = [v.kind for v in fixture.visits(disturbed.folder, SERIAL) if v.position == "x-up"]
    assert (at_x[0], at_x[-1]) == ("rejected", "tumble")
    assert r.fit is not None
    assert r.fit.calibration is not None
    # Twenty readings a face of 0.0004 g noise, two faces an axis: five standard errors and a half of a step.
    tolerance = 5 * 0.00041 / np.sqrt(20) + 0.5 * 6.25e-5
    matrix, offset = disturbed.truth
    np.testing.assert_allclose(r.fit.calibration.matrix, matrix, rtol=0, atol=tolerance)
    np.testing.assert_allclose(r.fit.calibration.offset, offset, rtol=0, atol=tolerance)


def test_an_error_frame_is_recorded_with_the_visit_it_fell_into(disturbed: Disturbed) -> None:
    (observed,) = [(f.time_us, f.can_id, f.data) for f in disturbed.observed if f.can_id & ERROR_FLAG]
    assert observed[1:] == (ERROR_FLAG | CONTROLLER, PASSIVE)
    visits = fixture.visits(disturbed.folder, SERIAL)
    hit = next(visit for visit in visits if visit.position == "y-down")
    for visit in visits:
        stored = [row for row in fixture.rows(visit.frames) if row[1] & ERROR_FLAG]
        assert stored == ([observed] if visit is hit else [])
        shown = visit.statistics["bus_errors"]
        assert len(shown) == len(stored)
        assert all("error passive while receiving" in text for text in shown)


def test_a_flood_that_may_not_be_repeated_ends_in_an_error_and_writes_nothing(vcan: Interface, tmp_path: Path) -> None:
    with (
        fixture.Served(vcan, (NODE,), (SERIAL,), memory=tmp_path) as served,
        fixture.opened(
            tmp_path, vcan, (NODE,), bus=SMALL_BUFFER, positioner=fixture.DRIVEN, recipe={"visit_repeats": 0}
        ) as bench,
    ):
        ran = fixture.run(bench, [SERIAL], served.turn, During(z_up=lambda: flood(vcan)))
    r = ran.results[SERIAL]
    assert (r.outcome, r.written) == (Outcome.ERROR, False)
    assert any("The kernel dropped" in reason.sentence for reason in r.reasons)
    (attempt,) = fixture.life(tmp_path, SERIAL)
    assert [(v["kind"], v["position"]) for v in attempt["visits"]] == [("rejected", "z-up")]
    assert attempt["writes"] == []
    assert not (tmp_path / f"{SERIAL}.json").exists()


def test_bus_off_ends_the_run_and_names_the_interface(vcan: Interface, tmp_path: Path) -> None:
    def off() -> None:
        cansend(vcan, ERROR_FLAG | BUS_OFF, bytes(8))

    with (
        fixture.Served(vcan, (NODE,), (SERIAL,)) as served,
        fixture.opened(tmp_path, vcan, (NODE,), positioner=fixture.DRIVEN) as bench,
    ):
        ran = fixture.run(bench, [SERIAL], served.turn, During(z_up=off))
    assert isinstance(ran.fault, BusFault)
    assert f"{vcan.name}: the controller is bus-off" in ran.fault.sentence
    assert ran.results[SERIAL].outcome is Outcome.ERROR
    (attempt,) = fixture.life(tmp_path, SERIAL)
    assert attempt["outcome"] == "ERROR"


def test_a_link_that_goes_down_ends_the_run_truthfully_and_the_next_one_passes(
    shaped_vcan: Callable[[int], Link], tmp_path: Path
) -> None:
    link = shaped_vcan(1_000_000)
    near = link.near
    with (
        fixture.Served(link.far, (NODE,), (SERIAL,), flash_s=0.05) as served,
        fixture.opened(tmp_path, near, (NODE,), positioner=fixture.DRIVEN) as bench,
    ):
        cut = fixture.run(bench, [SERIAL], served.turn, During(z_down=near.down))
        assert isinstance(cut.fault, BusFault)
        assert cut.fault.sentence == f"{near.name} went down: bring it up with `ip link set {near.name} up`."
        assert cut.results[SERIAL].outcome is Outcome.ERROR
        assert not cut.results[SERIAL].written
        near.up()
        until(lambda: bench.station.bus.state() == "active", "the link")
        again = fixture.run(bench, [SERIAL], served.turn)
    assert [e.device_serial for e in again.events if isinstance(e, Identified)] == [42]
    assert (again.results[SERIAL].reasons, again.results[SERIAL].outcome) == ((), Outcome.PASS)
    first, second = fixture.life(tmp_path, SERIAL)
    assert (first["outcome"], second["outcome"]) == ("ERROR", "PASS")
    assert first["seal"] is not None
    assert result(first, "verdict")["reasons"][0]["sentence"] == cut.fault.sentence
    assert [e["kind"] for e in first["events"]].count("not-left-as-found") == 1
    assert {v["position"] for v in first["visits"]} == {"z-up"}
    assert first["writes"] == []


def test_a_queue_that_empties_no_more_ends_the_run_and_leaves_the_old_values(
    shaped_vcan: Callable[[int], Link], tmp_path: Path
) -> None:
    """ENOBUFS in the middle of a run: from the fourth stop on nothing that the station sends leaves its queue."""
    link = shaped_vcan(1_000_000)
    stuck = ("root", "tbf", "rate", "8bit", "burst", "16", "limit", "16")

    def jam() -> None:
        run("tc", "qdisc", "replace", "dev", link.near.name, *stuck)

    with (
        fixture.Served(link.far, (NODE,), (SERIAL,), memory=tmp_path, flash_s=0.05) as served,
        fixture.opened(tmp_path, link.near, (NODE,), positioner=fixture.DRIVEN) as bench,
    ):
        ran = fixture.run(bench, [SERIAL], served.turn, During(x_down=jam))
    r = ran.results[SERIAL]
    assert isinstance(ran.fault, BusFault)
    assert f"{link.near.name} could not send for 1 s because its queue is full" in ran.fault.sentence
    assert (r.outcome, r.written, r.verified) == (Outcome.ERROR, False, False)
    (attempt,) = fixture.life(tmp_path, SERIAL)
    # A visit that lost frames on a busy machine is measured again: readings still came, for all six.
    kept = [visit["position"] for visit in attempt["visits"] if visit["kind"] == "tumble"]
    assert (attempt["outcome"], len(kept), len(set(kept))) == ("ERROR", 6, 6)
    assert not (tmp_path / f"{SERIAL}.json").exists()
