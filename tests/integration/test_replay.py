"""A recorded log goes the run's own way: equal coefficients with its marks, found stills without, sentences else."""

import csv
import json
from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pytest

from station.adapters.annotations import find_marks_file, read_marks, write_marks
from station.adapters.bus import write_log
from station.adapters.bus._python_can import mf4
from station.adapters.store.reader import SqliteLogReader
from station.cli._replay import decode_log, replay_log
from station.domain.capture.annotations import Annotation, Annotations, annotate_visits
from station.domain.capture.visit import CapturedVisit
from station.domain.core.types import Frames, NestAssignment
from station.domain.product import product_record
from station.domain.run.progress import Event, LoadDone
from station.errors import LogError
from station.ports.bus import Channel
from station.ports.log_reader import Query
from station.service.stop_request import StopRequest
from station.wiring.bench import Bench
from tests.fakes import fixture_run
from tests.fakes.fixture_run import Ran


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Ran]:
    """A candump log of two units with its marks, as exported from a run's own record."""
    folder = tmp_path_factory.mktemp("recorded")
    listening: list[Channel] = []

    def listen(bench: Bench) -> Bench:
        listening.append(bench.station.bus.stream(()))
        return bench

    def keep(event: Event, _stop: StopRequest, _bench: Bench) -> None:
        if isinstance(event, LoadDone):
            write_log(folder / "whole.log", listening[0].receive(0.0))

    ran = fixture_run.run(folder, units=2, wrap=listen, hook=keep)
    parts, stops = [], []
    with SqliteLogReader(folder / "station.db") as log:
        for attempt in log.attempts(Query()):
            visits = log.attempt(attempt)["visits"]
            stored = [
                CapturedVisit(
                    v["run"], v["visit"], v["position"], v["seating"], v["arrived_ns"],
                    v["statistics"]["from_ns"], v["statistics"]["to_ns"], frames,
                )
                for v, frames in zip(visits, log.frames(attempt), strict=True)
                if v["kind"] == "tumble"
            ]  # fmt: skip
            _, layout = product_record.load(log.recipe_and_product(attempt)[1])
            stops.append((NestAssignment(attempt.serial, attempt.nest, attempt.node), stored, layout))
            parts += [v.frames for v in stored]
    frames = Frames.join(parts)
    frames = frames[np.argsort(frames.time_ns, kind="stable")]
    marks = [m for seat, stored, layout in stops for m in annotate_visits(seat, stored, layout, int(frames.time_ns[0]))]
    write_log(folder / "two.log", frames)
    write_log(folder / "two.blf", frames)
    write_marks(folder / "two.log.marks.json", Annotations(recipe="six-point", marks=tuple(marks)))
    write_marks(folder / "two-by-hand.csv", Annotations(marks=tuple(marks)))
    return folder, ran


def replayed(capsys: pytest.CaptureFixture[str], *args: object) -> dict[str, Any]:
    code = replay_log(*args, as_json=True)  # type: ignore[arg-type]
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "station.calibration/1"
    assert code == (0 if all(u["outcome"] == "PASS" for u in document["units"]) else 1)
    return {u["serial"]: u for u in document["units"]}


@pytest.mark.parametrize("name", ["two.log", "two.blf"])
def test_with_its_marks_a_log_gives_the_runs_own_coefficients(
    recorded: tuple[Path, Ran], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, ran = recorded
    units = replayed(capsys, folder / name, "six-point", folder / "two.log.marks.json")
    assert sorted(units) == ["SN0001", "SN0002"]
    for serial, r in ran.results.items():
        assert r.fit is not None
        assert r.fit.calibration is not None
        assert units[serial]["outcome"] == "PASS"
        # Time stamps in a log are rounded to microseconds; readings and dwells are the same, so are these, bit for bit.
        assert units[serial]["offset"] == r.fit.calibration.offset.tolist()
        assert units[serial]["matrix"] == r.fit.calibration.matrix.tolist()


def test_marks_beside_the_log_are_found_and_name_the_recipe(
    recorded: tuple[Path, Ran], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = recorded
    assert find_marks_file(folder / "two.log") == folder / "two.log.marks.json"
    assert len(replayed(capsys, folder / "two.log", None, None)) == 2


def test_marks_written_as_a_table_are_the_same(recorded: tuple[Path, Ran]) -> None:
    folder, _ = recorded
    assert read_marks(folder / "two-by-hand.csv").marks == read_marks(folder / "two.log.marks.json").marks


def test_without_marks_the_stills_are_found(recorded: tuple[Path, Ran], capsys: pytest.CaptureFixture[str]) -> None:
    folder, ran = recorded
    units = replayed(capsys, folder / "whole.log", "six-point", None)
    assert sorted(units) == ["node-17", "node-18"]
    for serial, unit in zip(("SN0001", "SN0002"), ("node-17", "node-18"), strict=True):
        r = ran.results[serial]
        assert r.fit is not None
        assert r.fit.calibration is not None
        std = np.sqrt(np.diagonal(r.fit.calibration.covariance))
        # Longer parts of the same stops: the means differ by a part of their own uncertainty.
        assert np.all(np.abs(np.array(units[unit]["offset"]) - r.fit.calibration.offset) < 3 * std[:3])


def test_a_log_that_shows_too_little_says_what_to_do(recorded: tuple[Path, Ran], tmp_path: Path) -> None:
    folder, _ = recorded
    lines = (folder / "two.log").read_text().splitlines()
    (tmp_path / "short.log").write_text("\n".join(lines[: len(lines) // 2]) + "\n")
    with pytest.raises(LogError, match=r"short\.log has no marks, and no device in it rests in every position"):
        replay_log(tmp_path / "short.log", "six-point", None, as_json=False)


def mark(**change: object) -> Annotation:
    shown = {"unit": "SN1", "node": 17, "run": 0, "visit": 0, "position": "z-up", "start_s": 0.3, "end_s": 1.3}
    return Annotation.model_validate({**shown, **change})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"position": "zz-up"}, "names position 'zz-up', which recipe six-point does not have"),
        ({"start_s": 900.0, "end_s": 901.0}, "is at 900 to 901 s, but the log covers 0 to"),
        ({"start_s": 2.0, "end_s": 1.0}, "is at 2 to 1 s"),
        ({"node": 99}, "No readings of unit SN1 (node 99)"),
    ],
)
def test_marks_that_do_not_fit_are_named(
    recorded: tuple[Path, Ran], tmp_path: Path, change: dict[str, object], words: str
) -> None:
    write_marks(tmp_path / "bad.json", Annotations(marks=(mark(**change),)))
    with pytest.raises(LogError) as caught:
        replay_log(recorded[0] / "two.log", "six-point", tmp_path / "bad.json", as_json=False)
    assert words in caught.value.sentence


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.json", "{", "line 1: this is not JSON"),
        ("a.json", '{"marks": [{"unit": "A"}]}', "key `marks.0.node`: is missing"),
        ("a.json", "[" * 100_000, "a.json"),
        ("a.csv", "unit,run\nA,0\n", "line 1: no column node, visit, position, start_s, end_s"),
        ("a.csv", "unit,node,run,visit,position,start_s,end_s\nA,x,0,0,z-up,0,1\n", "line 2: key `node`:"),
        ("a.csv", "unit,node,run,visit,position,start_s,end_s\nA,1,0,0,z-up,0,inf\n", "line 2: key `end_s`:"),
    ],
)
def test_unreadable_marks_are_one_sentence(tmp_path: Path, name: str, text: str, words: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(LogError) as caught:
        read_marks(tmp_path / name)
    assert words in caught.value.sentence
    assert "\n" not in caught.value.sentence


def test_a_real_log_decodes_frame_for_frame_as_cantools_does(
    reference_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = reference_data / "css_canmod" / "2F6913DB_00000004_00000001.MF4"
    dbc = reference_data / "css_canmod" / "canmod-gps.dbc"
    assert decode_log(log, dbc, tmp_path / "out.csv", as_json=True) == 0
    document = json.loads(capsys.readouterr().out)
    ours: dict[tuple[int, str], float] = {}
    with (tmp_path / "out.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            ours[int(row["frame"]), row["signal"]] = float(row["value"])
    database: Any = cantools.database.load_file(dbc)
    theirs: dict[tuple[int, str], float] = {}
    unknown, total = 0, 0
    with log.open("rb") as raw, mf4().MF4Reader(raw) as reader:
        for number, message in enumerate(reader):
            total += 1
            try:
                values = database.decode_message(message.arbitration_id, message.data, decode_choices=False)
            except KeyError:
                unknown += 1
                continue
            theirs |= {(number, name): float(value) for name, value in values.items()}
    assert (document["frames"], document["unknown_frames"]) == (total, unknown)
    assert ours == theirs
    assert len(ours) > 15_000
