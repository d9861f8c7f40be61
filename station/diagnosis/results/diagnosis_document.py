"""A diagnosis as the document `station.diagnosis/1` (docs/formats.md)."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from station.diagnosis.candidates.kernels import KERNEL_NAMES
from station.diagnosis.data.faults import GrossFault
from station.diagnosis.data.faults.gross_fault import BlockGain
from station.diagnosis.results.blind_spots import blind_spot_messages
from station.diagnosis.results.diagnose import Cause, Diagnosis, calibration_shift, floor_rms, residual_rms
from station.diagnosis.results.parameter_rows import estimate_rows, gain_document
from station.diagnosis.results.remaining_residual import remaining_rms
from station.diagnosis.search.finding import CauseFinding
from station.messages import render

SCHEMA = "station.diagnosis/1"


def document(
    d: Diagnosis, next_run: Mapping[str, Any] | None = None, line: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """The document; numbers finite or null, in the recipe's unit. line: see `line_impact.document`."""
    visits = d.search_result.first.view.scene.visits
    floor = d.floor.floor
    made = {
        "schema": SCHEMA,
        "data": {
            "units": len(d.samples.units),
            "runs": len(visits.group("run", 1)[1]),
            "visits": len(visits),
            "samples": d.samples.rows,
        },
        "verdict": d.verdict,
        "sentence": sentence(d),
        "baseline": {
            "residual_rms": residual_rms(d.search_result.first),
            "floor_rms": floor_rms(d.last, d.floor),
            "unit": d.recipe.unit,
        },
        "extended": {"residual_rms": remaining_rms(d.last), "unit": d.recipe.unit},
        "floor": {
            "noise": floor.noise,
            "repeatability_rad": floor.turn,
            "bias_walk": floor.walk,
            "within_stops": within_visit_rms(d),
        },
        "alarm": {
            "family_wise_level": d.level,
            "statistic": max([d.search_result.statistics[0], *(f.nats for f in d.faults)]),
            "threshold": d.search_result.threshold,
        },
        "causes": [*(_fault(f) for f in d.faults), *(_cause(c, d) for c in d.causes)],
        "unknown": {"depends_on": list(d.depends_on), **_hypotheses(d)},
        "not_testable": list(d.not_testable),
        "considered": _ranking_rows(d),
        "calibration_shift": {
            unit: {"offset": [float(x) for x in row[:3]], "gain": [float(x) for x in row[3:]]}
            for unit, row in calibration_shift(d.last, d.search_result.first).items()
        },
        "line": line,
        "next_run": next_run,
    }
    return {key: _finite(value) for key, value in made.items()}


def _finite(value: Any) -> Any:
    """The value with null for every number that JSON has no word for."""
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(x) for key, x in value.items()}
    return [_finite(x) for x in value] if isinstance(value, (list, tuple)) else value


def _hypotheses(d: Diagnosis) -> dict[str, Any]:
    """What was proposed for the unknown, where there is one."""
    if d.hypotheses is None:
        return {}
    from station.diagnosis.results.hypothesis_document import hypothesis_rows

    return {"hypotheses": hypothesis_rows(d.hypotheses, d.recipe.unit)}


def within_visit_rms(d: Diagnosis) -> float:
    """Rms of a visit's mean due to the scatter of its own samples, for use where no floor can be trusted; 0 where each
    visit is a single reading, which shows no scatter."""
    view = d.search_result.first.view
    count = view.reduced.count.sum(1)
    return float(view.sigma / np.sqrt(count.mean())) if count.max() > 1 else 0.0


def sentence(d: Diagnosis) -> str:
    """The finding in one sentence for a person."""
    found = "; ".join([*(f"{f.effect}, {f.sentence}" for f in d.faults), *cause_names(c.finding for c in d.causes)])
    rest = " and ".join(d.depends_on)
    by_verdict = {
        "none": " ".join(["The simulation accounts for the data.", *_reservations(d)]),
        "named": f"Found: {found}.",
        "incomplete": f"Found: {found}; what is left depends on {rest}.",
        "unknown": f"Something is wrong that no known cause explains; it depends on {rest}.",
    }
    return by_verdict[d.verdict]


def cause_names(findings: Iterable[CauseFinding]) -> list[str]:
    """Each cause once, with those that it cannot be told from; a cause with two forms was found twice."""
    forms: dict[str, list[CauseFinding]] = {}
    for finding in findings:
        forms.setdefault(finding.name, []).append(finding)
    return [_cause_name(name, found) for name, found in forms.items()]


def _cause_name(name: str, found: Sequence[CauseFinding]) -> str:
    others = [other for other in dict.fromkeys(o for f in found for o in f.indistinguishable_from) if other != name]
    alike = f" (or {', '.join(others)}: these data cannot tell)" if others else ""
    return f"{name}{', twice' if len(found) > 1 else ''}{alike}"


def _reservations(d: Diagnosis) -> list[str]:
    """What must be said beside a verdict of none."""
    return [render(m) for m in blind_spot_messages(d, within_visit_rms(d))] if d.verdict == "none" else []


def _cause(c: Cause, d: Diagnosis) -> dict[str, Any]:
    f = c.finding
    return {
        "effect": f.name,
        "probability": f.set_probability,
        "indistinguishable_from": list(f.indistinguishable_from),
        "level": "visit" if f.accepted is None else f.accepted.candidate.of,
        "parameters": parameter_rows(c, d),
        "gain": gain_document(c.gain),
    }


def parameter_rows(c: Cause, d: Diagnosis) -> list[dict[str, Any]]:
    """The numbers of a cause as docs/formats.md names them."""
    return _floor_parameters(c.finding.name, d) if c.estimate is None else estimate_rows(c.estimate, d.recipe.unit)


def _floor_parameters(name: str, d: Diagnosis) -> list[dict[str, Any]]:
    """The standard deviation of a cause that is a variance of the floor."""
    i = 1 if name == "repeatability" else 2
    value = (d.floor.floor.noise, d.floor.floor.turn, d.floor.floor.walk)[i]
    std = float(d.floor.covariance[i, i] ** 0.5 / (2 * value)) if value > 0 else 0.0
    label = ("angle", "rad") if i == 1 else ("step_std", d.recipe.unit)
    return [{"name": label[0], "axis": None, "of": "common", "value": value, "std": std, "unit": label[1]}]


def _fault(f: GrossFault) -> dict[str, Any]:
    return {
        "effect": f.effect,
        "probability": 1.0,
        "indistinguishable_from": list(f.indistinguishable_from),
        "level": f.level,
        "parameters": [
            {"name": n.name, "axis": n.axis, "of": n.of, "value": n.value, "std": n.std, "unit": n.unit}
            for n in f.numbers
        ],
        "gain": _block_gain(f.gain),
    }


def _block_gain(g: BlockGain | None) -> dict[str, Any]:
    if g is None:
        # Nothing could be held out.
        return dict.fromkeys(
            ("held_out_by", "per", "rms_before", "rms_after", "explained", "log_score", "std_error", "accepted")
        )
    before, after = g.rms_before, g.rms_after
    explained = None if before is None or after is None or before <= 0 else max(0.0, 1 - (after / before) ** 2)
    return {
        "held_out_by": g.held_out_by,
        "per": g.per,
        "rms_before": before,
        "rms_after": after,
        "explained": explained,
        "log_score": g.log_score,
        "std_error": g.std_error,
        "accepted": g.accepted,
    }


def _ranking_rows(d: Diagnosis) -> list[dict[str, Any]]:
    """Every cause of the library with its evidence when the first one was looked for, the likeliest first."""
    evidence, probability = d.search_result.ranking
    rows = [
        {"effect": name, "log_evidence": value, "probability": probability.get(name, 0.0)}
        for name, value in evidence.items()
        if name not in KERNEL_NAMES
    ]
    return sorted(rows, key=lambda row: -row["log_evidence"])
