"""Jobs over a fleet: the same bits on one process and on a cluster, resumed where they stopped, refused where wrong."""

import json
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from pyarrow import parquet

from station.adapters.fleet.dask_engine import DaskEngine, _compute_checked
from station.cli.app import main
from station.config.recipes import load_recipe
from station.domain.evaluation.backtest import BacktestTotals
from station.errors import InputError, RecipeError, StationFault
from station.ports.fleet import Columns, Portion
from station.ports.log_reader import Query
from station.service import backtest
from station.service.fleet import FleetJob, FleetPlan, InProcess, compute_missing, plan_portions
from station.wiring.fleet import code_version, open_results, open_source
from tests.fakes import fixture_run, fleet_work


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("fleet")
    fixture_run.run(made, units=4)
    return made


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskEngine]:
    """Two worker processes of this machine; each test of the module that needs some shares them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(fleet_work.MARKER, str(tmp_path_factory.mktemp("killed") / "once"))
        with DaskEngine(workers=2) as engine:
            yield engine


@pytest.fixture
def job(folder: Path, monkeypatch: pytest.MonkeyPatch) -> FleetJob:
    """A tighter recipe over four units, a portion each."""
    monkeypatch.setattr("station.service.fleet.PORTION", 1)
    tight = load_recipe(fixture_run.recipe(folder, limits={"offset": 0.03}))
    return FleetJob("backtest", tight, Query(), code_version())


def planned_of(job: FleetJob, folder: Path) -> FleetPlan:
    return plan_portions(job, [partial(open_source, folder / "station.db")])


def tables(place: Path) -> dict[str, list[dict[str, Any]]]:
    return {path.name: parquet.read_table(path).to_pylist() for path in place.rglob("*.parquet")}


def run(
    job: FleetJob, folder: Path, place: Path, engine: Any, function: Callable[..., Columns] = backtest.compare_portion
) -> tuple[BacktestTotals, list[int]]:
    done: list[int] = []
    planned = planned_of(job, folder)
    with open_results(place, job, backtest.COLUMNS, {"name": job.name}) as results:
        compute_missing(planned, function, engine, results, done.append)
        return backtest.sum_backtest(planned, results), done


def test_a_cluster_of_this_machine_is_reached_from_this_machine_alone(cluster: DaskEngine) -> None:
    del cluster
    own = {str(link.readlink()) for link in Path("/proc/self/fd").iterdir() if link.is_symlink()}
    rows = [line.split() for kind in ("tcp", "tcp6") for line in Path(f"/proc/net/{kind}").read_text().splitlines()[1:]]
    listening = [row[1] for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in own]
    assert listening
    assert all(address.startswith("0100007F:") for address in listening), listening  # 127.0.0.1


def test_a_cluster_that_loses_a_worker_gives_the_bits_of_one_process(
    job: FleetJob, folder: Path, cluster: DaskEngine, tmp_path: Path
) -> None:
    one, _ = run(job, folder, tmp_path / "one", InProcess())
    many, done = run(job, folder, tmp_path / "many", cluster, fleet_work.kill_once)
    assert sum(done) == 4
    assert tables(tmp_path / "one") == tables(tmp_path / "many")
    assert (one.verdicts, one.changes, one.summary("g")) == (many.verdicts, many.changes, many.summary("g"))
    assert 0 < len(one.changes) < 4


def test_a_workers_error_and_another_code_come_back_as_sentences(
    job: FleetJob, folder: Path, cluster: DaskEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RecipeError):
        run(job, folder, tmp_path, cluster, fleet_work.refuse)
    monkeypatch.setattr("station.adapters.fleet.dask_engine.code_version", lambda: "0.9.9+beef")
    with pytest.raises(InputError, match=r"runs other code than this command: 0\.2\.0\+.*here: 0\.9\.9\+beef"):
        # Another code has keys of its own: a portion under way would come back as what the first code made of it.
        run(replace(job, code="0.9.9+beef"), folder, tmp_path, cluster)
    with pytest.raises(InputError, match="install the same version"):
        _compute_checked("1.0.0+0", fleet_work.refuse, None)


def test_who_stops_reading_costs_nobody_else_the_same_portions(cluster: DaskEngine) -> None:
    """The keys of a run that ended are those of the next: what the first gave up is not lost to the second."""
    portions = [Portion(f"same-{i}", i) for i in range(6)]
    for _ in range(20):
        begun = cluster.compute(fleet_work.echo, portions)
        next(begun)
        assert isinstance(begun, Generator)
        begun.close()
        assert {key for key, _ in cluster.compute(fleet_work.echo, portions)} == {p.key for p in portions}


def test_a_second_start_computes_only_what_is_missing(job: FleetJob, folder: Path, tmp_path: Path) -> None:
    class Dying:
        """Stops like a coordinator that is killed after two portions."""

        def compute(
            self, function: Callable[..., Columns], portions: Iterable[Portion]
        ) -> Iterator[tuple[str, Columns]]:
            for done, pair in enumerate(InProcess().compute(function, portions)):
                if done == 2:
                    raise KeyboardInterrupt
                yield pair

    with pytest.raises(KeyboardInterrupt):
        run(job, folder, tmp_path, Dying())
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.parquet")}
    assert len(before) == 2
    found, done = run(job, folder, tmp_path, InProcess())
    assert done == [2, 1, 1]
    assert all(path.stat().st_mtime_ns == time for path, time in before.items())
    assert found.verdicts == run(job, folder, tmp_path / "whole", InProcess())[0].verdicts


def test_another_code_recipe_or_query_is_another_job_and_stale_portions_go(
    job: FleetJob, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(job, folder, tmp_path, InProcess())
    names = {path.name for path in tmp_path.rglob("*.parquet")}
    other = FleetJob("backtest", job.recipe, job.query, "0.9.9")
    assert not names & {f"portion-{p.key}.parquet" for p in planned_of(other, folder).portions}
    # A portion that has grown replaces the smaller one, so that the folder never holds a unit twice.
    monkeypatch.setattr("station.service.fleet.PORTION", 3)
    run(job, folder, tmp_path, InProcess())
    rows = [row["attempt"] for table in tables(tmp_path).values() for row in table]
    assert len(rows) == len(set(rows)) == 4


def test_tables_of_a_fleet_are_a_source_and_a_unit_in_two_sources_counts_once(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def command(*words: str | Path, code: int = 0) -> str:
        with pytest.raises(SystemExit) as ended:
            main([str(word) for word in words])
        shown = capsys.readouterr()
        assert ended.value.code == code, shown.err
        return shown.out if code in (0, 1) else shown.err

    db, fleet = folder / "station.db", tmp_path / "fleet"
    command("export", "--parquet", fleet, "--db", db)
    recipe = fixture_run.recipe(folder, limits={"offset": 0.03})
    same = ("--recipe", recipe, "--of", "six-point", "--processes", "1", "--json")
    answers = [json.loads(command("backtest", *same, "--db", source)) for source in (db, fleet)]
    for name in ("verdicts", "changed", "coefficients", "attempts", "head"):
        assert answers[0][name] == answers[1][name], name
    both = json.loads(command("backtest", *same, "--db", db, "--db", fleet))
    assert both["attempts"] == 4
    calibrated = [json.loads(command("calibrate", *same[:4], "--db", at, "--json", "-", code=1)) for at in (db, fleet)]
    assert calibrated[0]["outcomes"] == calibrated[1]["outcomes"]
    assert calibrated[0]["coefficients"] == calibrated[1]["coefficients"]
    assert "either a table" in command("calibrate", "--recipe", recipe, code=2)
    assert "raw frames" in command("backtest", *same, "--db", fleet, "--from-frames", code=2)
    (tmp_path / "empty").mkdir()
    assert "no tables of a fleet" in command("backtest", *same, "--db", tmp_path / "empty", code=2)
    damaged = next((fleet / "reduced").rglob("*.parquet"))
    damaged.write_bytes(damaged.read_bytes()[:-20])
    assert "no whole Parquet file" in command("backtest", *same, "--db", fleet, code=2)


@pytest.mark.parametrize(
    "address", ["nonsense", "http://host:80", "tcp://host", "tcp://host:x", "tcp://host:99999", "inproc://1/2/3"]
)
def test_what_is_no_address_of_a_scheduler_is_refused_at_once(address: str) -> None:
    with pytest.raises(InputError, match="is no address of a scheduler"):
        DaskEngine(address)


def test_a_scheduler_that_is_not_there_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("station.adapters.fleet.dask_engine._CONNECT_S", 1)
    with pytest.raises(StationFault, match=r"scheduler at tcp://127\.0\.0\.1:9 does not answer"):
        DaskEngine("tcp://127.0.0.1:9")
