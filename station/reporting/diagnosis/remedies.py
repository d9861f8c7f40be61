"""What to do about a cause, and what would make it visible: the words only, the physics is in the effect files."""

from collections.abc import Collection
from dataclasses import dataclass

from station import plugins
from station.model.effect import Effect
from station.model.model_file import EFFECTS

#: What to do on the line.
REMEDIES = {
    "cross-axis": "take the axes' angles into the calibration (method n-point), then they cost nothing",
    "package-rotation": "take the rotation into the calibration, or ask the supplier how the sensor is placed",
    "quadratic": "take the square into the calibration, or ask the supplier about the lot",
    "cubic": "take the cube into the calibration, or ask the supplier about the lot",
    "cross-quadratic": "take the product into the calibration, or ask the supplier about the lot",
    "asymmetry": "take the two gains into the calibration, or ask the supplier about the lot",
    "offset-temperature": "correct the offset by the device's own thermometer, or calibrate at one steady temperature",
    "gain-temperature": "correct the gain by the device's own thermometer, or calibrate at one steady temperature",
    "temperature-rate": "let the units reach the temperature of the room before the run, and keep draughts off",
    "warm-up": "power the units some time constants before the first stop",
    "bias-drift": "calibrate offsets at the middle of the run, or come back to one position and take the drift off",
    "bias-walk": "dwell longer, visit positions twice, and ask the supplier about low-frequency noise",
    "hysteresis": "go round in both directions and take the mean, or ask the supplier about the lot",
    "vibration-rectification": "switch the motors off while measuring, or decouple the fixture from them",
    "filter-lag": "lengthen the settling time of the recipe, or set a faster filter while calibrating",
    "quantization": "set the range and the output format that the data sheet promises",
    "stuck-bit": "check the packing of the frame, then have the converter or the device replaced",
    "clipping": "set a wider range; no calibration brings back what was cut off",
    "axis-permutation": "check how the unit sits in its nest, and the axes in the decoding, before anything else",
    "wrong-scale": "check range and unit of the device and in the decoding, before anything else",
    "nest-tilt": "shim or replace the seat of the nest, then measure its orientation again",
    "base-tilt": "level the rig",
    "index-error": "measure the positioner's angles and enter them in the recipe, or have the index serviced",
    "repeatability": "look for play in the positioner: clamp, bearing, brake; visit positions more than once meanwhile",
    "local-gravity": "enter latitude and altitude of the site in the recipe",
    "settling": "lengthen the settling time of the recipe, or stiffen the fixture",
    "lever-arm": "wait for the full stop: lengthen the settling time of the recipe",
    "clamp-creep": "wait after clamping, or clamp with less force",
    "motor-tone": "switch the motor off while measuring, or change the sample rate so that the tone averages out",
    "group-offset": "measure the same unit at both places to see which one is wrong",
    "step": "look at the seating and the solder joints of these units, and run them again",
    "disturbed-visit": "run these units again; look for who or what touches the rig",
    "gold-drift": "send the gold reference to be calibrated, and compare it with a second one",
    "lost-frames": "lower the load of the bus, or look at the adapter and its buffer",
    "duplicated-frames": "look at the acknowledge: termination, a second controller, the adapter",
    "reordered-frames": "replace the adapter or its driver; sort by the frame counter meanwhile",
    "clock-error": "take time from the host's clock, and ask the supplier about the oscillator",
}
_REMEDY_BY_LEVEL = {
    "device": "take it into the calibration, or ask the supplier",
    "rig": "have the rig put right",
    "bus": "have the bus looked at",
}

#: Which recipe makes a cause visible that a poorer one hides.
REVEALING_CHANGES = {
    "cubic": "add positions at 45°: at six faces a cube is a gain",
    "quadratic": "add positions at 45°, so that each axis sees three sizes",
    "asymmetry": "add positions at 45°, so that each axis sees three sizes",
    "cross-quadratic": "add positions at edges and corners: at six faces it is nought",
    "offset-temperature": "add a run 10 °C warmer",
    "gain-temperature": "add a run 10 °C warmer",
    "temperature-rate": "let the temperature go up and down within a run",
    "warm-up": "add a run with the units powered long before",
    "clamp-creep": "add a run without opening the clamp",
    "package-rotation": "add a run with the units turned in the nest (`seating`)",
    "nest-tilt": "add a run with the units turned in the nest (`seating`), or use several nests",
    "hysteresis": "add a run in reversed order",
    "index-error": "measure two units or more, and one run in reversed order",
    "repeatability": "come back to one position within a run",
    "local-gravity": "measure a gold reference",
    "group-offset": "measure the same unit at both places, and record `station`, `nest`, `lot`, `operator`",
    "gold-drift": "read a gold reference in the nest (`gold_x`, `gold_y`, `gold_z`)",
    "settling": "set `settle.time_s` to 0, so that the dwell begins while it still moves",
    "lever-arm": "set `settle.time_s` to 0, so that the dwell begins while it still moves",
    "filter-lag": "set `settle.time_s` to 0, so that the dwell begins while it still moves",
    "motor-tone": "record `motor` and `started_s`, with the motors on in one run and off in another",
    "vibration-rectification": "add a run with the motors off (`motors: off`)",
    "quantization": "say `device.lsb` in the recipe",
    "stuck-bit": "say `device.lsb` in the recipe",
    "clipping": "say `device.full_scale` in the recipe",
    "clock-error": "say `device.rate_hz` in the recipe, and dwell longer",
    "lost-frames": "record the frame `counter`",
    "duplicated-frames": "record the frame `counter`",
    "reordered-frames": "record the frame `counter`",
    "axis-permutation": "say the orientation of every position in the recipe",
    "disturbed-visit": "make more than one stop a unit",
    "step": "make more stops a run",
    "bias-drift": "make more stops a run, and come back to one position",
}
#: Covariates that follow from a column.
_SOURCE_COLUMNS = {"temperature_rate": "temperature_degC", "since_arrival_s": "time_s"}


@dataclass(frozen=True, slots=True)
class CauseText:
    """A cause in words: what it is, and what to do."""

    physics: str
    do: str


def cause_text(effect: str) -> CauseText:
    """A cause in words, by its id."""
    kind = _kind(effect)
    if kind is None:
        return CauseText(effect, "")
    return CauseText(kind.physics.rstrip("."), REMEDIES.get(effect, _REMEDY_BY_LEVEL[kind.level]))


def makes_testable(effect: str, recorded: Collection[str]) -> str:
    """Which column or which change of the recipe would show a cause that was not testable."""
    kind = _kind(effect)
    missing = [name for name in (kind.needs if kind else ()) if name not in recorded and name != "gold"]
    if missing:
        columns = " and ".join(f"`{_SOURCE_COLUMNS.get(name, name)}`" for name in missing)
        return f"record {columns} in the samples"
    return REVEALING_CHANGES.get(effect, "measure more positions, runs or units")


def needed_by(effect: str) -> tuple[str, ...]:
    """Covariates that a cause depends on."""
    kind = _kind(effect)
    return kind.needs if kind else ()


def unit_of(effect: str, unit: str) -> str:
    """The unit of a cause's coefficient where readings are in `unit`."""
    kind = _kind(effect)
    return kind.parameter.unit_in(unit) if kind else ""


def _kind(effect: str) -> type[Effect] | None:
    return plugins.load(EFFECTS, effect) if effect in plugins.names(EFFECTS) else None
