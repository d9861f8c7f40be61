"""What the growth benchmark feeds on: samples tables, recipes, configurations, frames and logs of any size."""

import contextlib
import os
import sys
from pathlib import Path

import numpy as np
import yaml

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from station.config.search_path import shipped_folder
from station.domain.core.types import Floats, Labels, SampleTable
from station.domain.recipe import directions
from tests.fakes import tumble

NOISE = 1e-3
#: Units written in one go, as a file of some size is.
TOGETHER = 100


def nothing(folder: Path, size: int) -> None:
    """The command makes what it needs."""


def samples(folder: Path, size: int) -> None:
    """One unit, 24 positions, so many samples."""
    _table(folder / f"samples-{size}", 1, directions.SOLIDS[24], size // 24)


def units(folder: Path, size: int) -> None:
    """So many units, 24 positions of 100 samples each."""
    _table(folder / f"units-{size}", size, directions.SOLIDS[24], 100)


def stops(folder: Path, size: int) -> None:
    """One unit that goes through six faces as often as makes so many stops, of ten samples each."""
    _table(folder / f"stops-{size}", 1, np.concatenate([np.eye(3), -np.eye(3)]), 10, size // 6)


def config(folder: Path, size: int) -> None:
    """A fixture with so many nests."""
    printed = yaml.safe_load((shipped_folder() / "config.yaml").read_text(encoding="utf-8"))
    printed["nests"] = [{"name": f"N{i}", "node": i + 1} for i in range(size)]
    (folder / f"nests-{size}.yaml").write_text(yaml.safe_dump(printed), encoding="utf-8")


def frames(folder: Path, size: int) -> None:
    """A candump log of so many units on one bus, with its marks."""
    out = str(folder / f"frames-{size}.log")
    station("simulate", "--recipe", "six-point", "--units", str(size), "--nests", "60", "--out", out)


def campaign(folder: Path, size: int) -> None:
    """Samples of so many simulated units with nothing wrong."""
    station("simulate", "--recipe", "tilt-24", "--units", str(size), "--out", str(folder / f"campaign-{size}.parquet"))


def log(folder: Path, size: int) -> None:
    """A log of so many units, all with all their records."""
    import audit
    import bulk_log

    one, path = folder / "one.db", folder / f"log-{size}.db"
    if not one.exists():
        audit.one_run(folder)
    if not path.exists():
        bulk_log.build(path, bulk_log.template(one, "SN0001"), size, 1)


def effects(number: int) -> list[str]:
    """Options that switch on so many of the known causes."""
    from station import plugins

    names = plugins.names("station.model.effects")
    return [word for name in names[:number] for word in ("--effect", name)]


def station(*words: str) -> None:
    """One command of the station, silent."""
    from station.cli.app import main

    with Path(os.devnull).open("w") as nowhere, contextlib.redirect_stdout(nowhere), contextlib.suppress(SystemExit):
        main(list(words))


def _table(path: Path, count: int, ups: Floats, each: int, runs: int = 1) -> None:
    """A recipe PATH.yaml and a table PATH.parquet of what `count` units read in its positions, run after run."""
    from station.adapters.samples import write_parts
    from station.domain.core.joined_tables import join

    names = {f"p{i:02d}": up for i, up in enumerate(ups)}
    recipe = tumble.recipe("n-point", ups=names, runs=[{"seating": "home"}] * runs)
    printed = recipe.model_dump(mode="json", by_alias=True, exclude_unset=True)
    path.with_suffix(".yaml").write_text(yaml.safe_dump(printed), encoding="utf-8")
    rng = np.random.default_rng(1)
    readings = tumble.readings(tumble.units(rng, count), tumble.truths(recipe))
    parts = (
        join([_one(u, readings[u], tuple(names), each, rng) for u in range(a, min(a + TOGETHER, count))])
        for a in range(0, count, TOGETHER)
    )
    write_parts(parts, path.with_suffix(".parquet"))


def _one(unit: int, readings: Floats, names: tuple[str, ...], each: int, rng: np.random.Generator) -> SampleTable:
    """One unit's samples: each stop's reading (v, 3) with noise, so many times."""
    n = len(readings) * each
    stop = np.repeat(np.arange(len(readings), dtype=np.int32), each)
    run = stop // len(names)
    return SampleTable(
        unit=Labels((f"SN{unit:06d}",), np.zeros(n, np.int32)),
        run=run.astype(np.int32),
        visit=(stop % len(names)).astype(np.int32),
        position=Labels(names, (stop % len(names)).astype(np.int32)),
        time_s=(np.arange(n, dtype=float) - run * len(names) * each) * 0.01,
        reading=np.repeat(readings, each, axis=0) + NOISE * rng.standard_normal((n, 3)),
    )
