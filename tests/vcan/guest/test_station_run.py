"""A whole run on a real interface, our devices in a process of their own; candump, canplayer and Node as witnesses."""

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from vcan_harness import fixture
from vcan_harness.interface import Interface, create_vcan
from vcan_harness.node import NodeMaster
from vcan_harness.programs import Candump, Logged, canplayer

from station.adapters.annotations import find_marks_file, read_marks
from station.adapters.bus import read_log
from station.adapters.bus.socketcan import SocketCan
from station.cli import app
from station.domain.capture.annotations import Annotation, Annotations
from station.domain.core.types import Frames, Outcome
from station.domain.records.stored_attempt import result
from station.service.replay import ReplayedUnit, replay
from station.wiring.jobs import load_job

NODES, SERIALS = (0x11, 0x12), ("SN0042", "SN0043")
COEFFICIENTS = [*((0x2101, sub) for sub in range(1, 10)), *((0x2102, sub) for sub in range(1, 4))]


@dataclass(frozen=True)
class Recorded:
    """One run of two units with candump listening, and what a foreign master read afterwards. folder: the log's."""

    folder: Path
    ran: fixture.Ran
    observed: list[Logged]
    foreign: dict[str, list[bytes]]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Recorded]:
    """One run serves every test here: it takes ten seconds."""
    folder = tmp_path_factory.mktemp("run")
    vcan = create_vcan("vcanrun")
    try:
        candump = Candump(vcan, folder / "candump.log")
        with fixture.Served(vcan, NODES, SERIALS, flash_s=0.05) as served:
            with fixture.opened(folder, vcan, NODES) as bench:
                ran = fixture.run(bench, SERIALS, served.turn)
            observed = candump.stop()
            with NodeMaster(vcan) as master:
                foreign = {
                    serial: [master.upload(node, *at) for at in COEFFICIENTS]
                    for serial, node in zip(SERIALS, NODES, strict=True)
                }
        yield Recorded(folder, ran, observed, foreign)
    finally:
        vcan.delete()


def test_both_units_pass_written_saved_read_back_verified_and_logged(recorded: Recorded) -> None:
    assert recorded.ran.fault is None
    for serial in SERIALS:
        r = recorded.ran.results[serial]
        assert r.reasons == ()
        assert (r.outcome, r.written, r.verified) == (Outcome.PASS, True, True)
        (attempt,) = fixture.life(recorded.folder, serial)
        assert attempt["outcome"] == "PASS"
        kinds = [v["kind"] for v in attempt["visits"]]
        assert [kind for kind in kinds if kind != "rejected"] == ["tumble"] * 6 + ["verify"] * 2
        assert {v["statistics"]["kernel_drops"] for v in attempt["visits"]} == {0}


def test_the_log_holds_what_candump_saw_byte_for_byte_in_order_and_time(recorded: Recorded) -> None:
    count = 0
    for serial, node in zip(SERIALS, NODES, strict=True):
        for visit in fixture.visits(recorded.folder, serial):
            stored = fixture.rows(visit.frames)
            first_us, last_us = stored[0][0], stored[-1][0]
            ids = (0x180 + node, 0x280 + node)
            observed = [
                (f.time_us, f.can_id, f.data)
                for f in recorded.observed
                if f.can_id in ids and first_us <= f.time_us <= last_us
            ]
            assert stored == observed
            count += len(stored)
    assert count > 2 * 8 * 20


def test_a_foreign_master_reads_the_new_coefficients(recorded: Recorded) -> None:
    for serial in SERIALS:
        fit = recorded.ran.results[serial].fit
        assert fit is not None
        assert fit.calibration is not None
        wanted = [*fit.calibration.matrix.ravel(), *fit.calibration.offset]
        assert recorded.foreign[serial] == [struct.pack("<f", value) for value in wanted]
        (attempt,) = fixture.life(recorded.folder, serial)
        logged = {w["object"]: w["read_back"] for w in attempt["writes"] if w["read_back"]}
        assert [logged[f"{i:04X}:{s:02X}"] for i, s in COEFFICIENTS] == [v.hex() for v in recorded.foreign[serial]]


def station(*args: str) -> object:
    """Exit code of a command in this process."""
    with pytest.raises(SystemExit) as left:
        app.main(args)
    return left.value.code


def by_unit(units: list[ReplayedUnit]) -> dict[str, tuple[list[float], list[list[float]]]]:
    fits = {u.seat.serial: u.result.calibration for u in units}
    return {serial: (fit.offset.tolist(), fit.matrix.tolist()) for serial, fit in fits.items() if fit is not None}


def moved_to(marks: Annotations, recorded_frames: Frames, played: Frames) -> Annotations:
    """The same marks by the number of the frame, in the times of the played log."""
    zero, then = int(recorded_frames.time_ns[0]), int(played.time_ns[0])

    def there(at_s: float) -> float:
        """Half-way between the two played frames whose originals enclose this time."""
        after = int(np.searchsorted(recorded_frames.time_ns, zero + round(at_s * 1e9)))
        low = int(played.time_ns[max(after - 1, 0)]) - (after == 0)
        high = int(played.time_ns[min(after, len(played) - 1)]) + (after == len(played))
        return ((low + high) / 2 - then) / 1e9

    moved = [
        Annotation(**{**m.model_dump(), "start_s": there(m.start_s), "end_s": there(m.end_s)}) for m in marks.marks
    ]
    return Annotations(recipe=marks.recipe, marks=tuple(moved))


def test_what_canplayer_plays_gives_the_same_coefficients(
    recorded: Recorded, vcan: Interface, capsys: pytest.CaptureFixture[str]
) -> None:
    log = recorded.folder / "unit.log"
    database = str(recorded.folder / "station.db")
    assert station("export", "--db", database, "--frames", str(log)) == 0
    capsys.readouterr()
    small = str(recorded.folder / "small.yaml")
    assert station("replay", str(log), "--recipe", small, "--json") == 0
    shown = {u["serial"]: u for u in json.loads(capsys.readouterr().out)["units"]}
    for serial in SERIALS:
        (attempt,) = fixture.life(recorded.folder, serial)
        first = result(attempt, "calibration")
        assert shown[serial]["offset"] == first["offset"]
        assert shown[serial]["matrix"] == first["matrix"]
        assert shown[serial]["outcome"] == "PASS"
    frames, where = read_log(log), find_marks_file(log)
    assert where is not None
    bus = SocketCan(vcan.name)
    stream = bus.stream(())
    canplayer(log, {log.read_text().split()[1]: vcan.name}, "-t")  # at once: only times differ, and no fit uses them
    played = stream.receive(1.0)
    bus.close()
    assert stream_of(played) == stream_of(frames)
    job, _ = load_job(small)
    marks = read_marks(where)
    there = by_unit(list(replay(played, moved_to(marks, frames, played), job)))
    assert there == {serial: (shown[serial]["offset"], shown[serial]["matrix"]) for serial in SERIALS}


def stream_of(frames: Frames) -> list[tuple[int, bytes]]:
    return [(can_id, data) for _, can_id, data in fixture.rows(frames)]
