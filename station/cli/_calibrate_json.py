"""`station.calibration/1` written unit by unit, so that memory does not grow with the units; whole or not at all."""

import shutil
import sys
import tempfile
from contextlib import ExitStack
from json import dumps
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from station.cli import _output
from station.errors import UsageError
from station.files.replace import replacing
from station.messages import system_reason


class CalibrationJsonWriter:
    """A context that takes units with `add`. path: a file, `-` for standard output, or None for nowhere.

    Nothing appears under that name, or on standard output, before the last unit is in. Errors: UsageError.
    """

    def __init__(self, path: Path | None, head: dict[str, Any]) -> None:
        self._path, self._head = path, head
        self._opened = ExitStack()
        self._file: IO[str] | None = None
        self._first = True
        self._tail: dict[str, Any] = {}

    def __enter__(self) -> "CalibrationJsonWriter":
        if self._path is not None:
            self._file = self._open(self._path)
            self._file.write(f'{dumps(self._head, ensure_ascii=False)[:-1]}, "units": [')
        return self

    def add(self, unit: dict[str, Any]) -> None:
        """Writes one unit."""
        if self._file is not None:
            self._file.write(("" if self._first else ", ") + _dumped(unit))
            self._first = False

    def append(self, key: str, value: Any) -> None:
        """What stands behind the units."""
        self._tail[key] = value

    def __exit__(self, kind: type[BaseException] | None, exc: BaseException | None, tb: TracebackType | None) -> None:
        if self._file is not None and kind is None:
            tail = "".join(f", {dumps(key)}: {_dumped(value)}" for key, value in self._tail.items())
            self._file.write(f"]{tail}}}\n")
            self._file.flush()
            if str(self._path) == "-":
                self._to_standard_output(self._file)
        self._opened.__exit__(kind, exc, tb)

    def _open(self, path: Path) -> IO[str]:
        if str(path) == "-":
            return self._opened.enter_context(tempfile.TemporaryFile("w+", encoding="utf-8"))
        try:
            part = self._opened.enter_context(replacing(path))
        except OSError as exc:
            raise UsageError("option-not-written", option="--json", path=str(path), why=system_reason(exc)) from exc
        return self._opened.enter_context(part.open("w", encoding="utf-8"))

    @staticmethod
    def _to_standard_output(file: IO[str]) -> None:
        file.seek(0)
        try:
            shutil.copyfileobj(file, sys.stdout)
            sys.stdout.flush()
        except BrokenPipeError:
            _output.print_raw()


def _dumped(value: Any) -> str:
    return dumps(value, allow_nan=False, ensure_ascii=False)
