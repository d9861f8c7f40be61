"""Tables of a fleet as Parquet, in hive partitions by product and day: `attempts/product=P/day=D/part.parquet`."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pyarrow as pa
from pyarrow import parquet

from station.files.replace import replacing

SCHEMA = "station.fleet/1"
#: Rows of one row group: some ten megabytes, far below what a reader holds at once.
_GROUP_ROWS = {"reduced": 1024}
_MOST_GROUP_ROWS = 65_536

_TIME = pa.timestamp("us", tz="UTC")
_COMMON = [
    *((name, pa.string()) for name in ("attempt", "serial", "station", "nest", "lot", "recipe_name")),
    ("recipe_version", pa.int64()),
    ("recipe_hash", pa.string()),
    ("outcome", pa.string()),
    ("started", _TIME),
    ("simulated", pa.string()),
]
_FLOATS = ("mean_x", "mean_y", "mean_z", "std_x", "std_y", "std_z")
_COUNTS = ("count", "gaps", "lost", "kernel_drops", "crc_errors", "late", "repeats")
TABLES = {
    "attempts": pa.schema(
        [
            *_COMMON,
            ("ended", _TIME),
            ("duration_s", pa.float64()),
            ("node", pa.int64()),
            *((name, pa.string()) for name in ("operator", "software", "config_hash", "firmware")),
            *((name, pa.float64()) for name in ("residual_rms", "false_accept", "false_reject")),
            ("written", pa.bool_()),
            ("verified", pa.bool_()),
            ("reasons", pa.list_(pa.string())),
            ("seal", pa.string()),
        ]
    ),
    "coefficients": pa.schema(
        [
            *_COMMON,
            ("coefficient", pa.string()),
            *((name, pa.float64()) for name in ("value", "std", "expanded", "k", "dof")),
            ("unit", pa.string()),
        ]
    ),
    "visits": pa.schema(
        [
            *_COMMON,
            ("run", pa.int64()),
            ("visit", pa.int64()),
            *((name, pa.string()) for name in ("position", "seating", "kind")),
            ("frame_count", pa.int64()),
            ("arrived", _TIME),
            ("left", _TIME),
            *((name, pa.float64()) for name in _FLOATS),
            *((name, pa.int64()) for name in _COUNTS),
            ("temperature_degC", pa.float64()),
        ]
    ),
    "reduced": pa.schema(
        [*_COMMON, *((name, pa.string()) for name in ("stops", "before", "recipe", "product_json", "history"))]
    ),
}


class FleetWriter:
    """Takes rows whose days do not go back; each file is whole when it has its name."""

    def __init__(self, folder: Path, head: str) -> None:
        self._folder, self._metadata = folder, {"schema": SCHEMA, "head": head}
        self._rows: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
        self._open: dict[tuple[str, str], tuple[parquet.ParquetWriter, Any]] = {}
        self._day = ""
        self.files, self.counts = 0, dict.fromkeys(TABLES, 0)

    def add(self, table: str, product: str, day: str, rows: list[dict[str, Any]]) -> None:
        """Rows of one partition. Errors: OSError."""
        if day != self._day:
            self.finish()
            self._day = day
        self.counts[table] += len(rows)
        waiting = self._rows.setdefault((table, product), [])
        waiting += rows
        if len(waiting) >= _GROUP_ROWS.get(table, _MOST_GROUP_ROWS):
            self._flush(table, product)

    def finish(self) -> None:
        """The present day is whole."""
        for table, product in list(self._rows):
            self._flush(table, product)
        for writer, place in self._open.values():
            writer.close()
            place.__exit__(None, None, None)
            self.files += 1
        self._open.clear()
        self._rows.clear()

    def abandon(self) -> None:
        """The present day is not written."""
        for writer, place in self._open.values():
            writer.close()
            with _ignored():
                place.__exit__(InterruptedError, InterruptedError(), None)
        self._open.clear()

    def _flush(self, table: str, product: str) -> None:
        rows = self._rows[table, product]
        if not rows:
            return
        if (table, product) not in self._open:
            folder = self._folder / table / f"product={quote(product, safe='')}" / f"day={self._day}"
            folder.mkdir(parents=True, exist_ok=True)
            place = replacing(folder / "part.parquet", durable=True)
            schema = TABLES[table].with_metadata(self._metadata)
            self._open[table, product] = parquet.ParquetWriter(place.__enter__(), schema, compression="zstd"), place
        self._open[table, product][0].write_table(pa.Table.from_pylist(rows, TABLES[table]))
        rows.clear()


@contextmanager
def _ignored() -> Iterator[None]:
    try:
        yield
    except InterruptedError:
        return
