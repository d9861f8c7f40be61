"""The shipped accelerometer as other makers build it: its map, EDS and DBC changed, and a recipe for it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from station.config.search_path import shipped_folder
from tests.fakes import fixture_run

DBC = shipped_folder() / "dbc"


def recipe(
    folder: Path,
    name: str = "six-point",
    *,
    product: Mapping[str, Any] | None = None,
    device_map: Mapping[str, Any] | None = None,
    eds: Mapping[str, str] | None = None,
    dbc: Mapping[str, str] | None = None,
    **changes: Any,
) -> str:
    """A recipe whose product differs from the shipped one; a value None takes a block out; eds, dbc: texts replaced."""
    target = folder / "dbc"
    target.mkdir(exist_ok=True)
    document = yaml.safe_load((DBC / "accelerometer.yaml").read_text())
    document |= {"name": "plant", **(product or {})}
    if device_map is not None:
        document["map"] = {k: v for k, v in (document["map"] | dict(device_map)).items() if v is not None}
    document = {k: v for k, v in document.items() if v is not None}
    (target / "plant.yaml").write_text(yaml.safe_dump(document))
    for suffix, edits in (("eds", eds or {}), ("dbc", dbc or {})):
        text = (DBC / f"accelerometer.{suffix}").read_text()
        for old, new in edits.items():
            assert old in text, old
            text = text.replace(old, new, 1)
        (target / f"accelerometer.{suffix}").write_text(text)
    return fixture_run.recipe(folder, name, product="plant", **changes)


def pdo(transmission: int = 254, *, event_timer_ms: int = 10) -> dict[str, str]:
    """Edits of the EDS: how its first PDO sends from power-on."""
    head = "[1800sub2]\nParameterName=Transmission type\nObjectType=0x7\nDataType=0x0005\nAccessType=rw\nDefaultValue="
    timer = "[1800sub5]\nParameterName=Event timer\nObjectType=0x7\nDataType=0x0006\nLowLimit=0\n"
    timer += "HighLimit=60000\nAccessType=rw\nDefaultValue="
    return {f"{head}254": f"{head}{transmission}", f"{timer}10": f"{timer}{event_timer_ms}"}


def mappable() -> dict[str, str]:
    """Edits of the EDS: the mapping of its first PDO may be written."""
    text = (DBC / "accelerometer.eds").read_text()
    head = text[text.index("[1A00sub0]") :]
    block = head[: head.index("[1A01]")]
    return {block: block.replace("AccessType=const", "AccessType=rw").replace("AccessType=ro", "AccessType=rw")}
