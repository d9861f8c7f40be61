"""What was understood of a recording, for a person and as JSON: every number, and whether it was stated or inferred."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from station.domain.capture import rest_segments
from station.domain.core.types import Array, Floats
from station.domain.recognition import sheet
from station.domain.recognition.columns import LEAST_TURN
from station.domain.recognition.quantities import USUAL_FIELD_UT, sphere
from station.domain.recognition.recording import Recording
from station.domain.recognition.samples import UnitRecording, Visits
from station.domain.recognition.visits import is_pose_each
from station.messages import Message

SCHEMA = "station.import/1"
#: Magnitudes are about the middle of the readings where it is off zero by this share of them, and it is said.
OFF_CENTRE = 0.1


def document(one: UnitRecording, visits: Visits | None) -> dict[str, Any]:
    """One pass: axes, unit, rate, magnitude, noise, resolution, range, poses, temperature; `inferred` names those that
    nothing stated."""
    r = one.recording
    edges = visits.edges if visits is not None else _quiet_seconds(r)
    rows = np.concatenate([np.arange(a, b) for a, b in edges])
    number = np.repeat(np.arange(len(edges)), edges[:, 1] - edges[:, 0])
    found = sheet.infer(r.reading[rows], r.time_s[rows], number)
    means = np.array([r.reading[a:b].mean(axis=0) for a, b in edges])
    centre = centre_of(means, r.unit)
    far = float(np.linalg.norm(centre)) > OFF_CENTRE * float(np.median(np.linalg.norm(means - centre, axis=1)))
    about = centre if far else np.zeros(3)
    size = np.linalg.norm(means - about, axis=1)
    warm = None if r.temperature_degC is None else r.temperature_degC[rows]
    return {
        "unit": one.serial,
        "run": one.run,
        "source": r.source,
        "readings": len(r),
        "duration_s": float(r.time_s[-1]),
        "axes": list(r.axes),
        "reading_unit": r.unit,
        "raw_unit": r.scale.unit,
        "scale": r.scale.factor,
        "zero": r.scale.zero,
        "time_unit": r.clock.unit,
        "rate_hz": r.clock.rate_hz,
        "jitter_s": r.clock.jitter_s,
        "gaps": r.clock.gaps,
        "restarts": r.clock.restarts,
        "visits": 0 if visits is None else len(visits.edges),
        "visits_by": None if visits is None else visits.found_by,
        "poses": None if visits is None else orientation_count(means, r.unit),
        "centre": about.tolist(),
        "magnitude": {"median": float(np.median(size)), "least": float(size.min()), "greatest": float(size.max())},
        "single_readings": bool(np.all(edges[:, 1] - edges[:, 0] == 1)),
        "noise": found.noise.tolist(),
        "lsb": found.lsb.tolist(),
        "full_scale": found.full_scale,
        "temperature_degC": None if warm is None else [float(warm.min()), float(warm.max())],
        "inferred": list(_inferred(r, visits)),
        "remarks": [m.document() for m in (*r.remarks, *(visits.remarks if visits else ()))],
    }


def _quiet_seconds(r: Recording) -> Array:
    """Edges (n, 2) of the quieter half of a recording's seconds, which nobody has cut into visits yet."""
    length = max(2, round(r.clock.rate_hz or 1.0))
    starts = np.arange(0, max(len(r) - length, 0) + 1, length)
    edges = np.stack([starts, np.minimum(starts + length, len(r))], axis=1)
    scatter = np.array([np.linalg.norm(r.reading[a:b].std(axis=0)) for a, b in edges])
    return np.asarray(edges[scatter <= np.median(scatter)])


def centre_of(means: Floats, unit: str) -> Floats:
    """The middle (3) of means (k, 3), about which they are as long as what is measured: zero but for what is turned all
    round. Of a compass it may be farther off than the field is large; of an accelerometer such a middle is gravity."""
    if unit == "deg/s":
        return np.zeros(3)
    wide = np.ptp(means, axis=0).max() > LEAST_TURN * np.median(np.linalg.norm(means, axis=1))
    if not wide and not (unit == "uT" and is_pose_each(means, any_offset=True)):
        return np.zeros(3)
    centre, radius = sphere(means)
    return centre if unit == "uT" or np.linalg.norm(centre) < radius else np.zeros(3)


def orientation_count(means: Floats, unit: str) -> int:
    """In how many orientations means (k, 3) show a unit, about their middle."""
    return int(rest_segments.orientations(means - centre_of(means, unit)).max(initial=-1)) + 1


def _inferred(r: Recording, visits: Visits | None) -> Iterator[str]:
    if r.axes_inferred:
        yield "axes"
    if r.scale.inferred:
        yield "unit"
    if r.clock.inferred:
        yield "time_unit"
    if r.clock.source != "given":
        yield "rate"
    if visits is not None and visits.found_by in ("rest", "shown-blocks", "readings", "files"):
        yield "visits"
    if r.degrees_inferred:
        yield "temperature"
    yield from ("noise", "lsb", "full_scale")


def messages(facts: dict[str, Any], remarks: tuple[Message, ...]) -> Iterator[Message]:
    """The same as lines for a person."""
    guess = Message("mark-inferred")
    stated = Message("mark-stated")

    def how(*names: str) -> Message:
        return guess if any(n in facts["inferred"] for n in names) else stated

    yield Message(
        "understood-file", file=facts["source"], unit=facts["unit"], run=facts["run"], readings=facts["readings"],
        duration_s=facts["duration_s"],
    )  # fmt: skip
    yield Message("understood-axes", axes=tuple(facts["axes"]), how=how("axes"))
    yield _unit_message(facts, how("unit"))
    yield _rate_message(facts, how("time_unit"))
    if facts["visits"]:
        key = f"visits-by-{facts['visits_by']}"
        yield Message("understood-visits", visits=facts["visits"], how=Message(key), poses=facts["poses"])
    size = facts["magnitude"]
    single = facts["single_readings"]
    yield Message(
        "understood-size" if single else "understood-magnitude", median=size["median"], least=size["least"],
        greatest=size["greatest"], unit=facts["reading_unit"],
    )  # fmt: skip
    if any(facts["centre"]):
        yield Message("understood-centre", centre=_three(facts["centre"]), unit=facts["reading_unit"])
    if single:
        yield Message("understood-steps", lsb=_three(facts["lsb"]), unit=facts["reading_unit"])
    else:
        yield Message(
            "understood-noise",
            noise=_three(facts["noise"]),
            lsb=_three(facts["lsb"]),
            unit=facts["reading_unit"],
        )
    if facts["full_scale"] is not None:
        yield Message("understood-full-scale", full_scale=facts["full_scale"], unit=facts["reading_unit"])
    if facts["temperature_degC"] is not None:
        low, high = facts["temperature_degC"]
        yield Message("understood-temperature", low=low, high=high, how=how("temperature"))
    yield from remarks


def _unit_message(facts: dict[str, Any], how: Message) -> Message:
    if facts["reading_unit"] == "deg/s" and "unit" in facts["inferred"] and facts["raw_unit"] in ("LSB", "deg/s"):
        known = facts["raw_unit"] == "deg/s"
        return (
            Message("understood-rate-unit") if known else Message("understood-rate-counts", counts=1 / facts["scale"])
        )
    counts = 1 / facts["scale"] if facts["raw_unit"] == "LSB" else 1.0
    if not float(np.log2(abs(counts))).is_integer():
        # No converter has so many counts: they are what makes the magnitude right.
        size = USUAL_FIELD_UT if facts["reading_unit"] == "uT" else 1.0
        return Message("understood-by-size", counts=counts, unit=facts["reading_unit"], size=size, zero=facts["zero"])
    if facts["zero"]:
        return Message(
            "understood-counts",
            zero=facts["zero"],
            counts=1 / facts["scale"],
            unit=facts["reading_unit"],
            how=how,
        )
    if facts["raw_unit"] == "LSB":
        return Message("understood-lsb", counts=1 / facts["scale"], unit=facts["reading_unit"], how=how)
    if facts["raw_unit"] == facts["reading_unit"]:
        return Message("understood-same-unit", unit=facts["reading_unit"], how=how)
    return Message(
        "understood-unit",
        raw=facts["raw_unit"],
        factor=facts["scale"],
        unit=facts["reading_unit"],
        how=how,
    )


def _rate_message(facts: dict[str, Any], how: Message) -> Message:
    if facts["time_unit"] == "none":
        return Message("understood-no-clock", rate_hz=facts["rate_hz"])
    return Message(
        "understood-rate", rate_hz=facts["rate_hz"], jitter_ms=1e3 * facts["jitter_s"], time_unit=facts["time_unit"],
        gaps=facts["gaps"], restarts=facts["restarts"], how=how,
    )  # fmt: skip


def _three(values: list[float]) -> tuple[str, ...]:
    return tuple(f"{v:.3g}" for v in values)
