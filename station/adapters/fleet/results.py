"""Results of portions as Parquet, one file each: `FOLDER/job=NAME-KEY/portion-KEY.parquet`."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import parquet

from station.errors import StoreFault
from station.files.replace import replace_text, replacing
from station.messages import system_reason
from station.ports.fleet import Columns, ColumnType

SCHEMA = "station.fleet-results/1"
_TYPES = {"text": pa.string(), "number": pa.float64(), "integer": pa.int64()}
_TYPES |= {f"{kind}s": pa.list_(of) for kind, of in _TYPES.items()}


class ParquetResults:
    """types: of the columns; about: what `job.json` and each file's footer say of the job. Errors: StoreFault."""

    def __init__(self, folder: Path, job: str, types: Mapping[str, ColumnType], about: Mapping[str, Any]) -> None:
        self.folder = folder / f"job={job}"
        self._schema = pa.schema([(name, _TYPES[kind]) for name, kind in types.items()])
        self._metadata = {"schema": SCHEMA, "job": json.dumps(about, ensure_ascii=False)}
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            text = json.dumps({"schema": SCHEMA, **about}, ensure_ascii=False, indent=2)
            replace_text(self.folder / "job.json", text, durable=True)
        except OSError as error:
            raise self._fault(error) from error

    def has(self, key: str) -> bool:
        """Whether the portion's result is there: a file takes its name only when it is whole."""
        return self._path(key).is_file()

    def write(self, key: str, columns: Columns) -> None:
        """Keeps a result, whole and durable when this returns."""
        table = pa.table(dict(columns), self._schema)
        try:
            with replacing(self._path(key), durable=True) as part:
                parquet.write_table(table.replace_schema_metadata(self._metadata), part, compression="zstd")
        except OSError as error:
            raise self._fault(error) from error

    def read(self, key: str) -> Columns:
        """A result that is there."""
        try:
            columns: dict[str, Any] = parquet.ParquetFile(self._path(key)).read().to_pydict()
        except (OSError, pa.ArrowException) as error:
            raise StoreFault("fleet-result-damaged", file=str(self._path(key))) from error
        return columns

    def retain(self, keys: Sequence[str]) -> None:
        """Deletes what belongs to no portion any more."""
        wanted = {self._path(key) for key in keys}
        try:
            for path in self.folder.glob("portion-*.parquet"):
                if path not in wanted:
                    path.unlink(missing_ok=True)
        except OSError as error:
            raise self._fault(error) from error

    def _path(self, key: str) -> Path:
        return self.folder / f"portion-{key}.parquet"

    def _fault(self, error: OSError) -> StoreFault:
        return StoreFault("fleet-results-not-written", folder=str(self.folder), why=system_reason(error))
