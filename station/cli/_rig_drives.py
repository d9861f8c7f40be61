"""The face of `station rig check`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from station.cli._output import print_json, print_line, print_message, print_remark
from station.domain.rig.rig_map import RigMap
from station.errors import UsageError
from station.files.replace import replace_text
from station.messages import Message, render, system_reason
from station.service.rig_check import RigCheck

SCHEMA = "station.rig-check/1"


@dataclass(frozen=True, slots=True)
class CheckRequest:
    """The options of `station rig check`."""

    config: Path | None
    recipe: str | None
    bench: bool
    mounted: str | None
    speed_deg_s: float
    correct: Path | None
    json: bool


def check(request: CheckRequest) -> int:
    """Commissions; exit code 0 where the rig is mounted as its map says, else 1."""
    from station.wiring.rig_check import commission
    from station.wiring.run_order import RunOrder

    if request.mounted and not request.bench:
        raise UsageError("option-needs-simulate", option="--mounted")
    order = RunOrder(recipe=request.recipe, config=request.config, simulate=request.bench, mounted=request.mounted)
    found = commission(order, request.speed_deg_s, lambda m: print_remark(render(m)))
    if request.correct is not None:
        write_map(request.correct, found.corrected)
    if request.json:
        print_json(_document(found))
    else:
        _print_findings(found, request.correct)
    return 1 if found.findings else 0


def write_map(path: Path, rig: RigMap) -> None:
    """Writes a map that a person may go on editing: without the defaults."""
    document = rig.model_dump(mode="json", by_alias=True, exclude_defaults=True)
    text = yaml.safe_dump({"schema": "station.rig/1", **document}, sort_keys=False, allow_unicode=True)
    try:
        replace_text(path, text)
    except OSError as exc:
        raise UsageError("file-not-written", file=str(path), why=system_reason(exc)) from exc


def map_document(rig: RigMap) -> dict[str, Any]:
    """The whole map, for a program."""
    return rig.model_dump(mode="json", by_alias=True)


def _print_findings(found: RigCheck, corrected: Path | None) -> None:
    fit = found.fit
    for axis, scale, std, zero, zero_std in zip(
        found.corrected.axes, fit.scale, fit.scale_std, fit.zero_deg, fit.zero_std_deg, strict=True
    ):
        print_line(f"{axis.name}: scale {scale:.5f} ± {std:.5f}, zero {zero:+.3f}° ± {zero_std:.3f}°")
    for message in found.findings or (Message("rig-check-all-well"),):
        print_message(message)
    if corrected is not None:
        print_message(Message("rig-check-corrected", file=str(corrected)))


def _document(found: RigCheck) -> dict[str, Any]:
    fit = found.fit
    axes = [
        {
            "name": axis.name,
            "drive": step.drive,
            "step_scale": step.scale,
            "scale": fit.scale[i],
            "scale_std": fit.scale_std[i],
            "zero_deg": fit.zero_deg[i],
            "zero_std_deg": fit.zero_std_deg[i],
        }
        for i, axis in enumerate(found.corrected.axes)
        for step in found.steps
        if step.axis == axis.name
    ]
    return {
        "schema": SCHEMA,
        "rig": found.rig.name,
        "well": not found.findings,
        "axes": axes,
        "findings": [render(m) for m in found.findings],
        "messages": [m.document() for m in found.findings],
        "corrected": map_document(found.corrected),
    }
