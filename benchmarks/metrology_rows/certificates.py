"""Digital certificates of random values: valid, and read back bit for bit."""

import importlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from metrology_rows.report import Report

from station.reporting.certificate import dcc


def certificates(units: int, report: Report) -> None:
    """DCC documents of random values: read back bit for bit; validated by each schema that --xsd names."""
    rng, same = report.generator(110), 0
    schemas = {schema.version: schema for schema in map(importlib.import_module("xmlschema").XMLSchema, report.xsd)}
    valid = dict.fromkeys(schemas, 0)
    for i in range(units):
        facts = random_facts(rng, i)
        read = dcc.read_quantities(dcc.to_xml(facts))
        same += all(read.get(name) == pair for name, pair in wanted_quantities(facts))
        for version, schema in schemas.items():
            valid[version] += schema.is_valid(dcc.to_xml(facts, version).decode())
    report.show(
        "DCC 3.3.0 read back, values and U bit for bit", 110, same / units, (1.0, 1.0), 0.0, f"{same} of {units}"
    )
    for version, count in valid.items():
        report.show(f"DCC {version} valid by its schema", 110, count / units, (1.0, 1.0), 0.0, f"{count} of {units}")


def wanted_quantities(facts: dict[str, Any]) -> Iterator[tuple[str, tuple[float, float | None]]]:
    """Every value of a document and its U, in SI."""
    factor = {"g": 9.80665}
    for c in facts["coefficients"]:
        f = factor.get(c["unit"], 1.0)
        yield c["name"], (c["value"] * f, c["expanded"] * f if c["estimated"] else None)
        for moment, words in (("as_found", "as found"), ("as_left", "as left")):
            if held := facts["held"][moment]:
                kept = [*held["offset"], *np.ravel(held["matrix"]).tolist()]
                yield f"{c['name']} {words}", (kept[c["index"]] * f, None)
    f = factor.get(facts["unit"], 1.0)
    for p, d in zip((facts["verification"] or {"positions": []})["positions"], facts["decisions"], strict=False):
        yield d["what"], (p["error"] * f, d["expanded"] * f)


def random_facts(rng: np.random.Generator, number: int) -> dict[str, Any]:
    """What a certificate holds, made up: every sensor's unit, one to three axes, devices that keep nothing."""
    text = ["", "Ünit & <sons>", "校准实验室", " blanks  inside "][number % 4]
    party = {"name": text, "street": text, "city": "", "post_code": "1", "country": "DE"}
    unit, axes = ["g", "uT", "deg/s", "deg"][number // 4 % 4], number % 3 + 1
    cells = [(i, "offset " + "xyz"[i]) for i in range(axes)]
    cells += [(3 + 3 * i + j, f"m{i}{j}") for i in range(axes) for j in range(axes)]
    held = {"offset": rng.normal(size=3).tolist(), "matrix": rng.normal(size=(3, 3)).tolist()} if number % 5 else None
    verified: list[dict[str, Any]] = [
        {"name": f"p{i}", "error": float(abs(rng.normal())), "std": float(rng.random()) + 1e-9} for i in range(3)
    ]
    decided = [
        {"what": what, "limit": 1.0, "guard": float(rng.random()), "margin": float(rng.normal()), "unit": unit,
         "expanded": float(rng.uniform(1.6, 12) * std), "false_accept": float(rng.random())}
        for what, std in [*((f"verification {v['name']}", v["std"]) for v in verified), ("offset x", 1.0)]
    ]  # fmt: skip
    return {
        "number": f"n{number}", "issued": "2026-11-22", "simulated": number % 2 == 0, "outcome": "PASS", "rule": text,
        "issuer": {"laboratory": party, "customer": party, "signatory": text, "accreditation": text},
        "item": {"serial": f"S{number}", "identity": {}, "lot": ""},
        "performed": {"began": "2026-11-22T00:00:00", "ended": None},
        "method": {"name": "six-point", "recipe": "r", "version": 1, "hash": "h", "software": "s"},
        "conditions": {"temperature_degC": float(rng.normal(20, 5)) if number % 7 else None,
                       "temperature_std_degC": 0.2},
        "unit": unit, "held": {"as_found": held, "as_left": held}, "decisions": decided,
        "verification": {"unit": unit, "positions": verified} if number % 3 else None,
        "references": [{"item": "fixture", "number": "C-1", "due": "2027-01-01"}] * (number % 3),
        "coefficients": [
            {"index": i, "name": n, "unit": unit if i < 3 else "1", "estimated": i % 5 > 0,
             "value": float(rng.normal() * 10.0 ** rng.integers(-9, 3)),
             "expanded": float(abs(rng.normal()) * 10.0 ** rng.integers(-9, 0)),
             "k": float(rng.uniform(1.6, 12.8)), "coverage_probability": 0.95}
            for i, n in cells
        ],
    }  # fmt: skip
