"""Whatever people, scanners, devices and files hand in: taken, or refused in one sentence, within seconds."""

import gc
import json
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.adapters.annotations import read_marks
from station.adapters.bus import read_log
from station.adapters.samples import read_samples
from station.cli.app import run_command
from station.config.recipes import load_recipe
from station.domain.recipe import serial
from station.errors import LogError, StationError, UsageError
from station.files import limited_process
from tests.endurance import hostile_files, torture_input
from tests.endurance.fuzz_targets import Target
from tests.endurance.torture_input import TOKENS
from tests.fakes import hostile

FILES = ("recipe", "config", "product", "model", "dbc", "eds")
NAMES = (*FILES, "samples.csv", "samples.parquet", "candump", "blf", "asc")


@pytest.fixture(scope="module")
def reading(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Target]:
    return torture_input.targets(tmp_path_factory.mktemp("good"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bad")


def test_good_input_is_taken(reading: Mapping[str, Target], folder: Path) -> None:
    assert {name: torture_input.attempt(t, t.good, folder) for name, t in reading.items()} == dict.fromkeys(
        reading, "taken"
    )
    assert set(NAMES) < set(reading)


@pytest.mark.parametrize("name", [*NAMES, "frames", "serials", "fault"])
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_whatever_is_handed_in_is_taken_or_refused_in_one_sentence(
    reading: Mapping[str, Target], folder: Path, name: str, seed: int
) -> None:
    target = reading[name]
    data = torture_input.mutate(target.good, np.random.default_rng(seed))
    assert torture_input.attempt(target, data, folder) in ("taken", "refused")


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=6, deadline=None)
@given(data=st.one_of(st.binary(max_size=400), st.text(max_size=200).map(lambda t: t.encode("utf-8", "replace"))))
def test_noise_is_refused_in_one_sentence(reading: Mapping[str, Target], folder: Path, name: str, data: bytes) -> None:
    assert torture_input.attempt(reading[name], data, folder) in ("taken", "refused")


#: In the place of any value of a document.
ODD_VALUES = ("1e999", "NaN", "9" * 5000, "null", "[[]]", "{}", '"\\ud800"', "-1")


@pytest.mark.parametrize(
    "name",
    [
        "marks",
        "queue",
        "line-command",
        "line-adjustment",
        "questions",
        "owner",
        "alerts",
        "shipping",
        "screen",
        "golden",
        "head",
    ],
)
def test_any_odd_value_anywhere_in_a_document_is_taken_or_refused(
    reading: Mapping[str, Target], folder: Path, name: str
) -> None:
    good = json.loads(reading[name].good)
    texts = [b"[" * 100_000, b'{"a":' * 100_000, *(value.encode() for value in ODD_VALUES)]
    texts += [text.encode() for value in ODD_VALUES for text in with_each_value(good, value)]
    shown = {text: torture_input.attempt(reading[name], text, folder) for text in texts}
    assert {text: what for text, what in shown.items() if what not in ("taken", "refused")} == {}


@pytest.mark.parametrize("name", ["key", "public-key"])
def test_a_key_of_a_kind_that_nobody_knows_is_refused(reading: Mapping[str, Target], folder: Path, name: str) -> None:
    altered = reading[name].good.replace(b"K2Vw", b"K4Vw")  # the last byte but one of the object identifier
    assert altered != reading[name].good
    assert torture_input.attempt(reading[name], altered, folder) == "refused"


def with_each_value(document: Any, value: str) -> Iterator[str]:
    """The document as text, one of its values after the other exchanged."""
    rows = document.items() if isinstance(document, dict) else enumerate(document)
    for key, held in list(rows):
        document[key] = "\0value"
        yield json.dumps(document).replace(json.dumps("\0value"), value)
        if isinstance(held, dict | list):
            for text in with_each_value(held, value):
                document[key] = "\0held"
                yield json.dumps(document).replace(json.dumps("\0held"), text)
        document[key] = held


@pytest.mark.parametrize("name", NAMES)
def test_ten_megabytes_of_one_line_take_no_minutes(reading: Mapping[str, Target], folder: Path, name: str) -> None:
    assert torture_input.attempt(reading[name], b"a: [" + b"x, " * ((10 << 20) // 3), folder) in ("taken", "refused")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("candump", b"(9767225600.010000) can0 185#00\n"),
        ("asc", torture_input.ASC.replace(b"1  191 ", b"1  1942A1FBC3F21 ", 1)),
    ],
)
def test_times_and_identifiers_beyond_any_frame(
    reading: Mapping[str, Target], folder: Path, name: str, data: bytes
) -> None:
    assert torture_input.attempt(reading[name], data, folder) == "refused"


@pytest.mark.parametrize("token", TOKENS)
def test_no_scanned_text_reaches_a_file_or_a_query(token: bytes) -> None:
    text = "SN0001" + token.decode("utf-8", "surrogateescape")
    try:
        assert serial.check(text, load_recipe(torture_input.RECIPE)).isalnum()
    except UsageError as refused:
        assert refused.sentence.isprintable()


def with_a_wrong_checksum(recording: bytes) -> bytes:
    """An MF4 whose first compressed block ends in another Adler-32."""
    at = recording.index(b"##DZ")
    end = at + int.from_bytes(recording[at + 8 : at + 16], "little")
    data = bytearray(recording)
    for i in range(end - 12, end):
        data[i] ^= 0xFF
    return bytes(data)


def test_what_a_hundred_thousand_inputs_found(reading: Mapping[str, Target], folder: Path) -> None:
    found = {
        "mf4": with_a_wrong_checksum(reading["mf4"].good),
        "samples.parquet": reading["samples.parquet"].good.replace(b"visit", b"\xf4isit"),
        "samples.csv": reading["samples.csv"].good.replace(b",0,0,", b",1e999,0,", 1),
        "dbc": reading["dbc"].good.replace(b"(0.01,0)", b"(0.01," + b"9" * 400 + b")"),
    }
    assert {name: torture_input.attempt(reading[name], data, folder) for name, data in found.items()} == dict.fromkeys(
        found, "refused"
    )


def test_a_recording_that_crashes_its_reader_is_one_sentence(
    reading: Mapping[str, Target], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "crash.mf4").write_bytes(reading["mf4"].good)
    monkeypatch.setattr(
        limited_process, "_CODE", "import os, signal, sys; sys.path[:] = {path!r}; os.kill(os.getpid(), 11)"
    )
    with pytest.raises(LogError, match=r"crash\.mf4 is not a readable recording, it crashes the reader"):
        read_log(folder / "crash.mf4")


def test_a_recording_that_promises_more_than_a_machine_holds_is_one_sentence(
    reading: Mapping[str, Target], folder: Path
) -> None:
    data = bytearray(reading["mf4"].good)
    cycles = data.index(b"##CG") + 24 + 6 * 8 + 8  # ASAM MDF 4.1, block CG: header, links, record id
    data[cycles : cycles + 8] = (1 << 44).to_bytes(8, "little")
    assert torture_input.attempt(reading["mf4"], bytes(data), folder) == "refused"


@pytest.mark.parametrize("block", [b"MDF", b"##HD", b"##FH", b"##CG"])
def test_a_damaged_recording_is_one_sentence_and_its_reader_says_nothing_beside_it(
    reading: Mapping[str, Target], folder: Path, block: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    data = bytearray(reading["mf4"].good)
    zeroed = data.index(block)  # a compressed comment before it is as long as its identifiers happen to pack
    data[zeroed : zeroed + 8] = bytes(8)
    (folder / "d.mf4").write_bytes(data)
    with pytest.raises(LogError) as refused:
        read_log(folder / "d.mf4")
    gc.collect()
    assert capfd.readouterr() == ("", "")
    assert "BytesIO" not in refused.value.sentence
    assert "object at 0x" not in refused.value.sentence


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("mat cell dims", "needs more than 210 MB of memory"),
        ("mat deep cells", "holds no table of numbers"),
        ("parquet repeated text", "needs more than 210 MB of memory"),
        ("parquet zeros", "unfolds to 192 MB"),
        ("rate-comment-rows.csv", "at rest"),
        ("long-name.csv", "name of column 4 is longer than 200 characters"),
    ],
)
def test_a_recording_made_to_exhaust_its_reader_is_one_sentence(
    folder: Path, monkeypatch: pytest.MonkeyPatch, name: str, sentence: str
) -> None:
    """Some of those that `make torture` hands to the real commands, with less memory and with what fills it sooner."""
    monkeypatch.setattr(limited_process, "LEAST_MEMORY", 200 << 20)
    place = folder / name.replace(" ", "-")
    place.mkdir()
    (file,) = (f for f in hostile.every(hostile_files.shipped()) if f.name in (name, f"import {name}"))
    file.make(place)
    began_s = time.process_time()
    with pytest.raises(StationError, match=sentence):
        run_command(["import", str(next(place.iterdir()))])
    assert time.process_time() - began_s < 3


@pytest.mark.parametrize("name", ["marks many", "marks deep", "marks digits", "marks keys", "marks table"])
def test_marks_made_to_exhaust_their_reader_are_one_sentence(folder: Path, name: str) -> None:
    place = folder / name.replace(" ", "-")
    place.mkdir()
    (file,) = (f for f in hostile.every(hostile_files.shipped()) if f.name == name)
    file.make(place)
    (path,) = place.glob("*.marks.*")
    began_s = time.process_time()
    with pytest.raises(LogError):
        read_marks(path)
    assert time.process_time() - began_s < 3


def test_a_name_of_a_megabyte_is_no_unit(folder: Path) -> None:
    path = folder / "long.csv"
    path.write_text(f"{hostile.SAMPLES_HEADER}\n{'u' * 1_000_000},0,0,z-up,0,0,0,1\n")
    with pytest.raises(StationError, match=r"line 2.* longer than 200 characters|longer"):
        read_samples(path)
