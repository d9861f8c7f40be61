"""`station audit` and `station export` over a log that the run itself wrote."""

import csv
import json
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from pyarrow import parquet

from station.cli._audit_text import print_audit
from tests.fakes import fixture_run, logs
from tests.fakes.command import station

Out = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def db(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two units that passed, one that failed and passed at its second attempt."""
    folder = tmp_path_factory.mktemp("audit")
    fixture_run.run(folder, ["SN0001", "SN0002"])
    tight = fixture_run.recipe(folder, limits={"offset": 1e-6})
    fixture_run.run(folder, ["SN0003"], recipe=tight)
    fixture_run.run(folder, ["SN0003"])
    return folder / "station.db"


def requested(capsys: Out, *args: object) -> Any:
    station(*args, "--json")
    return json.loads(capsys.readouterr().out)


def test_a_units_whole_life_with_every_attempt(db: Path, capsys: Out) -> None:
    life = requested(capsys, "audit", "SN0003", "--db", db)
    assert (life["schema"], life["serial"], life["count"]) == ("station.audit/1", "SN0003", 2)
    failed, passed = life["attempts"]
    assert (failed["outcome"], passed["outcome"]) == ("FAIL", "PASS")
    assert failed["writes"] == []
    assert {"identity", "calibration", "verdict", "verification"} <= {r["name"] for r in passed["results"]}
    assert [v["kind"] for v in passed["visits"]] == ["tumble"] * 6 + ["verify"] * 2
    assert all({"mean", "std", "count", "gaps", "kernel_drops"} <= set(v["statistics"]) for v in passed["visits"])
    last = {w["object"]: w for w in passed["writes"]}
    assert last["2101:01"]["read_back"] == last["2101:01"]["written"] != last["2101:01"]["old"]
    assert len(passed["recipe_hash"]) == len(passed["config_hash"]) == 64
    assert life["head"]["number"] >= passed["seal"]["number"] > failed["seal"]["number"]


def test_a_life_is_readable_too(db: Path, capsys: Out) -> None:
    assert station("audit", "SN0003", "--db", db) == 0
    sentences = capsys.readouterr().out
    for part in ("1. SN0003: FAIL", "2. SN0003: PASS", "beyond 1e-06", "2101:01", "verify-tilt", "sealed", "head of"):
        assert part in sentences


def test_a_life_is_readable_whatever_an_older_version_did_not_record(db: Path, capsys: Out) -> None:
    life = requested(capsys, "audit", "SN0003", "--db", db)
    for attempt in life["attempts"]:
        for result in attempt["results"]:
            whole = result["document"]
            for missing in whole:
                result["document"] = {key: value for key, value in whole.items() if key != missing}
                print_audit(life)
                assert "head of" in capsys.readouterr().out, (result["name"], missing)
            result["document"] = whole


def test_calibrations_come_out_again_bit_for_bit(db: Path, capsys: Out) -> None:
    assert station("audit", "--recompute", "--db", db, "--json") == 0
    again = json.loads(capsys.readouterr().out)["recompute"]
    assert [r["serial"] for r in again] == ["SN0003", "SN0003", "SN0002", "SN0001"]
    assert all(r["identical"] and r["compared"] > 200 for r in again)


def edited_calibration(db: Path, copy: Path, edit: Callable[[dict[str, Any]], object]) -> int:
    """A copy of the log whose first calibration was edited; the record's number."""
    with sqlite3.connect(db) as source, sqlite3.connect(copy) as target:
        source.backup(target)
    with logs.unguarded(copy) as edited:
        number, text = edited.execute("SELECT seq, document FROM result WHERE name = 'calibration'").fetchone()
        document = json.loads(text)
        edit(document)
        edited.execute("UPDATE result SET document = ? WHERE seq = ?", (json.dumps(document), number))
    return int(number)


def next_float(document: dict[str, Any]) -> None:
    document["matrix"][1][2] = float(np.nextafter(document["matrix"][1][2], 1))


def test_one_changed_bit_of_a_stored_coefficient_is_told(db: Path, tmp_path: Path, capsys: Out) -> None:
    copy = tmp_path / "station.db"
    number = edited_calibration(db, copy, next_float)
    assert station("audit", "SN0001", "--recompute", "--verify", "--db", copy) == 2
    sentences = capsys.readouterr().out
    assert f"edited: result record {number} was edited" in sentences
    assert "1 of" in sentences
    assert "come out differently: matrix[1][2]" in sentences


@pytest.mark.parametrize(
    ("by", "code", "sentence"),
    [(0.0, 0, "values within rounding"), (1e-7, 2, "come out differently: matrix[1][2]")],
)
def test_what_another_processor_computed_may_differ_by_its_rounding(
    by: float, code: int, sentence: str, db: Path, tmp_path: Path, capsys: Out
) -> None:
    def of_another(document: dict[str, Any]) -> None:
        document["arithmetic"] = "that of another processor"
        document["matrix"][1][2] += by
        next_float(document)

    edited_calibration(db, copy := tmp_path / "station.db", of_another)
    assert station("audit", "SN0001", "--recompute", "--db", copy) == code
    assert sentence in capsys.readouterr().out


def test_containment_is_one_question(db: Path, capsys: Out) -> None:
    def serials(*options: str) -> list[str]:
        return [a["serial"] for a in requested(capsys, "audit", "--db", db, *options)["attempts"]]

    assert serials("--outcome", "fail") == ["SN0003"]
    assert serials("--recipe", "six-point", "--nest", "B") == ["SN0002"]
    assert serials("--firmware", "1.0.0", "--limit", "2") == ["SN0003", "SN0003"]
    assert serials("--firmware", "9.9.9") == []
    assert serials("--until", "2020-01-01") == []
    assert serials("--since", "2020-01-01", "--station", "bench-1") == ["SN0003", "SN0003", "SN0002", "SN0001"]


def test_the_chain_is_whole_and_answers_to_its_printed_head(db: Path, capsys: Out) -> None:
    report = requested(capsys, "audit", "--verify", "--db", db)
    number = report["head"]["number"]
    assert report["verify"] == {
        "records": number,
        "whole": True,
        "findings": [],
        "anchors": [{"place": f"head file {db}.head", "number": number, "state": "agrees"}],
        "acknowledged": [],
        "journal": {"lines": 0, "sealed": 0},
        "accounts": None,
    }
    printed = f"{report['head']['number']}:{report['head']['hash']}"
    assert station("audit", "--verify", "--db", db, "--head", printed) == 0
    assert station("audit", "--verify", "--db", db, "--head", f"{report['head']['number'] + 5}:{'0' * 64}") == 2
    assert "its end was cut off" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("args", "sentences"),
    [
        (["SN9999"], "holds no such attempt of serial 'SN9999'"),
        (["--since", "yesterday"], "--since 'yesterday' is not a time; write 2026-11-21"),
        (["--verify", "--head", "5:ab"], "--head wants NUMBER:HASH"),
        (["--head", f"5:{'a' * 64}"], "--head goes with --verify only"),
        (["--limit", "0"], "--limit"),
        (["--outcome", "passed"], "'passed' is not an outcome; choose one of PASS, FAIL"),
        (["--check", "gians"], "'gians' is no limit that a unit can fail (nearest: gain"),
        (["--verify", "--key", "none.pem"], "none.pem cannot be read (no such file or folder)"),
    ],
)
def test_wrong_questions_end_in_one_sentence(db: Path, args: list[str], sentences: str, capsys: Out) -> None:
    assert station("audit", *args, "--db", db) == 2
    shown = capsys.readouterr()
    assert sentences in shown.err
    assert shown.err.count("\n") == 1


def test_samples_results_and_frames_go_out_with_the_head_they_came_from(db: Path, tmp_path: Path, capsys: Out) -> None:
    table, rows, log = tmp_path / "s.parquet", tmp_path / "r.csv", tmp_path / "SN0001.log"
    report = requested(capsys, "export", "--db", db, "--samples", table, "--results", rows)
    head = f"{report['files'][0]['head']['number']}:{report['files'][0]['head']['hash']}"
    metadata = parquet.read_metadata(table).metadata
    assert (metadata[b"schema"], metadata[b"head"]) == (b"station.samples/1", head.encode())
    read = parquet.read_table(table).to_pydict()
    assert sorted({(u, r) for u, r in zip(read["unit"], read["run"], strict=True)}) == [
        ("SN0001", 0),
        ("SN0002", 0),
        ("SN0003", 0),
        ("SN0003", 1),
    ], "a serial that was tried again goes on counting its runs"
    with rows.open() as file:
        results = list(csv.DictReader(file))
    assert [(r["serial"], r["outcome"]) for r in results] == [
        ("SN0001", "PASS"),
        ("SN0002", "PASS"),
        ("SN0003", "FAIL"),
        ("SN0003", "PASS"),
    ]
    assert station("export", "--db", db, "--serial", "SN0001", "--frames", log) == 0
    assert head in capsys.readouterr().out
    extra = json.loads((tmp_path / "SN0001.log.export.json").read_text())
    assert (f"{extra['head']['number']}:{extra['head']['hash']}", len(extra["attempts"])) == (head, 1)


def unit(document: Any, serial: str) -> dict[str, Any]:
    return next(u for u in document["units"] if u["serial"] == serial)


@pytest.mark.parametrize("ending", ["log", "blf"])
def test_an_exported_log_replays_to_the_same_coefficients(db: Path, tmp_path: Path, ending: str, capsys: Out) -> None:
    log = tmp_path / f"both.{ending}"
    requested(capsys, "export", "--db", db, "--serial", "SN0001", "--serial", "SN0002", "--frames", log)
    replayed = requested(capsys, "replay", log)
    for serial in ("SN0001", "SN0002"):
        (life,) = requested(capsys, "audit", serial, "--db", db)["attempts"]
        stored = next(r["document"] for r in life["results"] if r["name"] == "calibration")
        report = unit(replayed, serial)
        assert (report["offset"], report["matrix"]) == (stored["offset"], stored["matrix"])


def test_an_exported_table_calibrates_to_the_same_coefficients(db: Path, tmp_path: Path, capsys: Out) -> None:
    table, out = tmp_path / "s.csv", tmp_path / "c.json"
    requested(capsys, "export", "--db", db, "--serial", "SN0002", "--samples", table)
    station("calibrate", "--samples", table, "--recipe", "six-point", "--json", out)
    capsys.readouterr()
    (life,) = requested(capsys, "audit", "SN0002", "--db", db)["attempts"]
    stored = next(r["document"] for r in life["results"] if r["name"] == "calibration")
    report = unit(json.loads(out.read_text()), "SN0002")
    assert np.allclose(report["offset"], stored["offset"], rtol=0, atol=1e-12)
    assert np.allclose(report["matrix"], stored["matrix"], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("args", "sentences"),
    [
        ([], "Nothing to write"),
        (["--samples", "a.xlsx"], "the file's ending must be one of .parquet, .csv"),
        (["--frames", "nowhere/a.log"], "the folder nowhere does not exist"),
        (["--results", "a.csv", "--serial", "SN9"], "holds no such attempt"),
    ],
)
def test_exports_that_cannot_be_end_in_one_sentence(
    db: Path, tmp_path: Path, args: list[str], sentences: str, capsys: Out, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert station("export", *args, "--db", db) == 2
    assert sentences in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [], "nothing half-written is left"


def test_a_station_with_a_key_signs_every_record(tmp_path: Path, capsys: Out, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    key, other = Path("station.key"), Path("other.key")
    pem = (serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    for path in (key, other):
        path.write_bytes(Ed25519PrivateKey.generate().private_bytes(*pem))
    fixture_run.run(tmp_path, config=fixture_run.config(tmp_path, signing_key=str(key)))
    db = tmp_path / "station.db"
    assert station("audit", "--verify", "--db", db) == 0
    assert station("audit", "--verify", "--db", db, "--key", key) == 0
    assert station("audit", "--verify", "--db", db, "--key", other) == 2
    assert "was not signed by this key" in capsys.readouterr().out
