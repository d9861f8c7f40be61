"""Every example of the helps and guides that needs a plant, in the folder that `station demo` leaves."""

from pathlib import Path

import psycopg
import pytest

from station.cli.app import run_command
from station.wiring.demo_folder import create_folder
from tests.fakes import logs
from tests.fakes.help_examples import (
    GUIDES,
    Tried,
    all_documented,
    guide_examples,
    needs_plant,
    serves,
    try_example,
    words_of,
)
from tests.fakes.plant import FakePlant, FakeStation, Server

pytestmark = pytest.mark.timeout(300)

#: 2026-11-15, within the month that an example of docs/fleet-tables.md exports.
IN_NOVEMBER_NS = 1_794_700_800 * 10**9


def test_every_example_runs_where_postgresql_answers(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """PostgreSQL as a person has it: found by PGHOST, with a database `plant`; one log waits there for a decision."""
    folder = tmp_path / "station-demo"
    create_folder(folder)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PGHOST", str(server.folder))
    monkeypatch.setenv("PGUSER", "postgres")
    with psycopg.connect(server.uri, autocommit=True) as db:
        db.execute("CREATE DATABASE plant")
    _ship_two_logs(tmp_path)
    shown = (*all_documented(), *(line for page in GUIDES for line in guide_examples(page)))
    lines = [line for line in dict.fromkeys(shown) if needs_plant(line)]
    assert len(lines) >= 8
    for line in lines:
        if serves(line):
            tried = try_example(line, folder)
        else:
            tried = Tried(line, run_command(words_of(line)[1:]), capsys.readouterr().err)
        assert tried.right, tried


def _ship_two_logs(folder: Path) -> None:
    """A station's log, and another of its name after its disk was replaced: the plant sets that one apart."""
    plant = FakePlant("postgresql:///plant", folder / "frames")
    first = FakeStation("bench-1", folder)
    other = folder / "new-disk"
    other.mkdir()
    second = FakeStation("bench-1", other, first.key)
    for station in (first, second):
        with station.store() as store:
            logs.unit(store, "SN0042", started_ns=IN_NOVEMBER_NS)
        standing = plant.take_all(station)
        assert (standing.refusal is not None) == (station is second)
    plant.connections.close()
