"""The face of `station rig check`, and of simulated drives."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from station.cli._output import print_json, print_line, print_message, print_remark
from station.errors import UsageError
from station.files.replace import replace_text
from station.messages import Message, render
from station.service.rig_check import RigCheck

#: What `--simulate` calls them.
DRIVES = "cia402"
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


def serve_drives(rig: str, channel: str, faults: tuple[str, ...], seconds: float | None) -> int:
    """Serves until the time is over, or Ctrl-C, which is the way to stop it and no failure."""
    from station.wiring.live_rig import LiveRig

    live = LiveRig.open(rig, channel, faults)
    print_json({"rig": live.rig.name, "axes": [a.name for a in live.rig.axes], "channel": channel})
    until_s = None if seconds is None else time.monotonic() + seconds
    try:
        live.live(lambda: until_s is None or time.monotonic() < until_s)
    except KeyboardInterrupt:
        print_remark("the drives left the bus")
    return 0


def check(request: CheckRequest) -> int:
    """Commissions; exit code 0 where the rig is mounted as its map says, else 1."""
    from station.wiring.rig_check import commission
    from station.wiring.run_order import RunOrder

    if request.mounted and not request.bench:
        raise UsageError("option-needs-simulate", option="--mounted")
    order = RunOrder(recipe=request.recipe, config=request.config, simulate=request.bench)
    found = commission(order, request.mounted, request.speed_deg_s, lambda m: print_remark(render(m)))
    if request.correct is not None:
        document = found.corrected.model_dump(mode="json", by_alias=True, exclude_defaults=True)
        text = yaml.safe_dump({"schema": "station.rig/1", **document}, sort_keys=False, allow_unicode=True)
        replace_text(request.correct, text)
    if request.json:
        print_json(_document(found))
    else:
        _print_findings(found, request.correct)
    return 1 if found.findings else 0


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
        "corrected": found.corrected.model_dump(mode="json", by_alias=True),
    }
