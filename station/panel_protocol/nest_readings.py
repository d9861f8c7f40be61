"""What the units in the nests send before a run, as one small file beside the log: by a listener, for the page."""

import json
import os
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from station.files.json_text import NOT_AS_EXPECTED, read_json
from station.files.replace import replace_text
from station.panel_protocol.companion import Companion, companion_file

SCHEMA = "station.readings/1"
#: A reading that is older is none, s.
MOST_AGE_S = 2.0


@dataclass(frozen=True, slots=True)
class NestReading:
    """What the unit of that serial read last. vector (3): recipe's unit; temperature_degC: None where it tells none."""

    serial: str
    vector: tuple[float, ...]
    temperature_degC: float | None = None


def write_readings(database: Path, readings: Mapping[str, NestReading]) -> None:
    """Nest → reading of now. Errors: OSError."""
    nests = {nest: asdict(reading) for nest, reading in readings.items()}
    document = {"schema": SCHEMA, "pid": os.getpid(), "at_s": time.time(), "nests": nests}
    replace_text(companion_file(database, Companion.READINGS), json.dumps(document, allow_nan=False))


def remove_readings(database: Path) -> None:
    """Nothing is listened to any more."""
    companion_file(database, Companion.READINGS).unlink(missing_ok=True)


def read_readings(database: Path, now_s: float) -> dict[str, NestReading]:
    """Nest → its newest reading; nothing where it is older than MOST_AGE_S, or in no shape of write_readings."""
    try:
        document = read_json(companion_file(database, Companion.READINGS))
        if abs(now_s - float(document["at_s"])) > MOST_AGE_S:
            return {}
        return {str(nest): _reading(one) for nest, one in document["nests"].items()}
    except (OSError, *NOT_AS_EXPECTED):
        return {}


def _reading(one: Mapping[str, object]) -> NestReading:
    """Errors: ValueError, TypeError, KeyError, OverflowError where it is none."""
    vector = [float(v) for v in one["vector"]]  # type: ignore[attr-defined]
    temperature = one.get("temperature_degC")
    return NestReading(str(one["serial"]), tuple(vector), None if temperature is None else float(str(temperature)))
