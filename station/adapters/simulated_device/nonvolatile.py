"""The non-volatile memory of a simulated device: what was saved last, in this process or in a file that outlives it."""

import json
from collections.abc import Mapping
from pathlib import Path

from station.errors import ConfigError, UsageError
from station.files.json_text import parse_json
from station.files.replace import replace_text
from station.messages import system_reason

#: Values by address, written as: {"2101:01": 1.0}. Bytes are hex text.
SavedObjects = dict[str, int | float | str]


def object_key(index: int, sub: int) -> str:
    """An address as the memory writes it: 2101:01."""
    return f"{index:04X}:{sub:02X}"


def address_of(key: str) -> tuple[int, int]:
    """The address in such a key."""
    index, sub = key.split(":")
    return int(index, 16), int(sub, 16)


class NonVolatileMemory:
    """Saved objects. path: a JSON file {"objects": {…}}, exactly as last saved; None: lives as long as this value."""

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self._objects: SavedObjects = {}
        if path is not None and path.exists():
            self._objects = _read(path)

    @classmethod
    def of_serial(cls, folder: Path, serial: str) -> "NonVolatileMemory":
        """The memory of the device with this printed serial: folder/SERIAL.json. Errors: UsageError, ConfigError."""
        if not serial or not all(c.isalnum() or c in "-_." for c in serial) or serial.startswith("."):
            raise UsageError("serial-names-no-file", serial=serial[:40])
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as exc:
            raise ConfigError("memory-folder-not-made", folder=str(folder), why=system_reason(exc)) from exc
        return cls(folder / f"{serial}.json")

    @property
    def program_path(self) -> Path | None:
        """File of the program that runs, beside that of the objects."""
        return None if self._path is None else self._path.with_suffix(".program.json")

    def objects(self) -> SavedObjects:
        """What was saved last."""
        return dict(self._objects)

    def store(self, objects: Mapping[str, int | float | str]) -> None:
        """Stores these objects in place of the old ones: all of them or, when power fails, none."""
        self._objects = dict(objects)
        if self._path is not None:
            replace_text(self._path, json.dumps({"objects": self._objects}, indent=1), durable=True)

    def clear(self) -> None:
        """Forgets everything: factory values at the next start."""
        self.store({})


def _read(path: Path) -> SavedObjects:
    try:
        objects: SavedObjects = parse_json(path.read_text(encoding="utf-8"), finite=False)["objects"]
        return dict(objects)
    except (OSError, ValueError, KeyError, TypeError) as exc:
        raise ConfigError("memory-damaged", file=str(path)) from exc
