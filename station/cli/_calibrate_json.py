"""`station.calibration/1` written unit by unit, so that memory does not grow with the units; whole or not at all."""

import os
import shutil
import sys
import tempfile
from json import dumps
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from station.cli import _output
from station.errors import UsageError


class CalibrationJsonWriter:
    """A context that takes units with `add`. path: a file, `-` for standard output, or None for nowhere.

    Nothing appears under that name, or on standard output, before the last unit is in. Errors: UsageError.
    """

    def __init__(self, path: Path | None, head: dict[str, Any]) -> None:
        self._path, self._head = path, head
        self._file: IO[str] | None = None
        self._first = True

    def __enter__(self) -> "CalibrationJsonWriter":
        if self._path is not None:
            self._file = self._open(self._path)
            self._file.write(f'{dumps(self._head, ensure_ascii=False)[:-1]}, "units": [')
        return self

    def add(self, unit: dict[str, Any]) -> None:
        """Writes one unit."""
        if self._file is not None:
            self._file.write(("" if self._first else ", ") + dumps(unit, allow_nan=False, ensure_ascii=False))
            self._first = False

    def __exit__(self, kind: type[BaseException] | None, _error: object, _trace: TracebackType | None) -> None:
        if self._file is None or self._path is None:
            return
        with self._file as file:
            if kind is None:
                file.write("]}\n")
                file.flush()
                if str(self._path) == "-":
                    self._to_standard_output(file)
        if str(self._path) != "-":
            self._settle(self._path, keep=kind is None)

    @property
    def _part(self) -> Path:
        assert self._path is not None
        return self._path.with_name(f"{self._path.name}.part")

    def _open(self, path: Path) -> IO[str]:
        if str(path) == "-":
            return tempfile.TemporaryFile("w+", encoding="utf-8")
        try:
            return self._part.open("w", encoding="utf-8")
        except OSError as exc:
            told = f"--json {path} cannot be written ({exc.strerror}); name a file in a folder that exists"
            raise UsageError(told) from exc

    def _settle(self, path: Path, *, keep: bool) -> None:
        if keep:
            os.replace(self._part, path)  # noqa: PTH105 - one name, whole or not at all
        else:
            self._part.unlink()

    @staticmethod
    def _to_standard_output(file: IO[str]) -> None:
        file.seek(0)
        try:
            shutil.copyfileobj(file, sys.stdout)
            sys.stdout.flush()
        except BrokenPipeError:
            _output.print_line()
