"""Tables of a fleet as a source of units: what `station export --parquet` wrote, for jobs over a fleet."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import pyarrow as pa
from pyarrow import parquet

from station.adapters.samples.fleet import SCHEMA
from station.errors import LogError
from station.ports.log_reader import Query, ReducedAttempt, SelectedAttempt
from station.ports.store import LogHead

#: What a query of these tables may name.
_FILTERS = ("serial", "station", "nest", "lot", "recipe_name", "recipe_hash", "outcome")
#: A row's number: its file's place in the order of paths, then its place in the file.
_ROWS_A_FILE = 1 << 32


def _origin(row: Mapping[str, Any]) -> tuple[bool, str]:
    """Whether it was simulated, and what the log had taught it."""
    return bool(row["simulated"]), row.get("history") or ""


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """LogError where Parquet finds damage, at the opening or in a page met later."""
    try:
        yield
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise LogError("fleet-table-damaged", file=str(path)) from error


class FleetTables:
    """A folder of tables. Errors: LogError."""

    def __init__(self, folder: Path) -> None:
        self.location = str(folder)
        self._files = sorted((folder / "reduced").rglob("*.parquet"))
        self._documents: dict[str, int] = {}
        if not self._files:
            raise LogError("fleet-tables-none", folder=self.location)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, tb: TracebackType | None, /
    ) -> None:
        """Nothing stays open."""

    def head(self) -> LogHead:
        """The head of the log that the first file came from."""
        with self._open(0) as file:
            number, _, seal = (file.schema_arrow.metadata or {}).get(b"head", b"0:").decode().partition(":")
        return LogHead(int(number), seal)

    def selection(self, query: Query) -> Iterator[SelectedAttempt]:
        """Attempts that the query names, one at a time, in the order of files and rows."""
        for number, row in self._selected(query, ("attempt",)):
            yield SelectedAttempt(number, row["attempt"], row["outcome"])

    def recipes(self, query: Query) -> list[str]:
        """The JSON of every recipe that those attempts were made with."""
        return sorted({row["recipe"] for _, row in self._selected(query, ("recipe",))})

    def reduced(self, numbers: Sequence[int]) -> list[ReducedAttempt]:
        """Those of the attempts that came to a calibration, in the order of their numbers."""
        found: list[ReducedAttempt] = []
        for place, own in groupby(sorted(numbers), lambda number: number // _ROWS_A_FILE):
            wanted = [number % _ROWS_A_FILE for number in own]
            found += self._rows(place, wanted)
        return found

    def document(self, number: int) -> str:
        """The product that `reduced` names."""
        return next(text for text, own in self._documents.items() if own == number)

    def _rows(self, place: int, wanted: list[int]) -> Iterator[ReducedAttempt]:
        columns = [
            "attempt",
            "serial",
            "stops",
            "before",
            "product_json",
            "station",
            "nest",
            "lot",
            "started",
            "simulated",
        ]
        with self._open(place) as file, _readable(self._files[place]):
            if "history" in file.schema_arrow.names:  # tables of earlier versions have none
                columns.append("history")
            begins = 0
            for group in range(file.num_row_groups):
                rows = file.metadata.row_group(group).num_rows
                own = [number - begins for number in wanted if begins <= number < begins + rows]
                if own:
                    table = file.read_row_group(group, columns).take(own)
                    began_ns = (table.column("started").cast(pa.int64()).to_numpy() * 1000).tolist()
                    for i, at_ns, row in zip(own, began_ns, table.drop_columns("started").to_pylist(), strict=True):
                        product = self._documents.setdefault(row["product_json"], len(self._documents))
                        number = place * _ROWS_A_FILE + begins + i
                        what = number, row["attempt"], row["serial"], product, row["stops"], row["before"]
                        yield ReducedAttempt(*what, row["station"], row["nest"], row["lot"], at_ns, *_origin(row))
                begins += rows

    def _selected(self, query: Query, columns: Sequence[str]) -> Iterator[tuple[int, Mapping[str, Any]]]:
        filters = {name: value for name in _FILTERS if (value := getattr(query, name)) is not None}
        names = sorted({*columns, *filters, "outcome", "started"})
        for place in range(len(self._files)):
            with self._open(place) as file, _readable(self._files[place]):
                number = place * _ROWS_A_FILE
                for batch in file.iter_batches(columns=names):
                    began_ns = batch.column("started").cast(pa.int64()).to_numpy() * 1000
                    for i, row in enumerate(batch.drop_columns(["started"]).to_pylist()):
                        if all(row[name] == value for name, value in filters.items()) and (
                            (query.since_ns or 0) <= began_ns[i] < (query.until_ns or 1 << 62)
                        ):
                            yield number + i, row
                    number += batch.num_rows

    def _open(self, place: int) -> parquet.ParquetFile:
        path = self._files[place]
        with _readable(path):
            file = parquet.ParquetFile(path)
        schema = (file.schema_arrow.metadata or {}).get(b"schema", b"").decode(errors="replace")
        if schema != SCHEMA:
            raise LogError("fleet-table-other-schema", file=str(path), schema=schema, expected=SCHEMA)
        return file
