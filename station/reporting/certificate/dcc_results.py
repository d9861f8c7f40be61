"""Results of a DCC: coefficients with the decision on each, the calibration as found and as left, the verification."""

from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree as ET

from station.domain.evaluation import verification
from station.domain.methods import coverage
from station.domain.methods.coefficients import NAMES
from station.messages import Message, render
from station.reporting.certificate.dcc_elements import (
    add_element,
    add_quantity,
    add_text,
    add_uncertainty,
    si_value,
    xml_word,
)
from station.reporting.certificate.facts import DISTRIBUTION, GAIN_NAMES
from station.reporting.number_text import format_risk


def add_results(into: ET.Element, facts: Mapping[str, Any], version: str) -> None:
    """The one measurement: method, equipment, conditions, results. facts: `facts.of_attempt`."""
    into = add_element(into, "measurementResult")
    add_text(into, "name", "calibration")
    method = add_element(add_element(into, "usedMethods"), "usedMethod")
    add_text(method, "name", f"{facts['method']['name']}: recipe {facts['method']['recipe']}")
    add_element(method, "reference", f"version {facts['method']['version']}, {facts['method']['hash']}")
    if facts["references"]:
        equipments = add_element(into, "measuringEquipments")
        for reference in facts["references"]:
            _equipment(add_element(equipments, "measuringEquipment"), reference)
    if facts["conditions"]["temperature_degC"] is not None:
        _temperature(add_element(add_element(into, "influenceConditions"), "influenceCondition"), facts, version)
    results = add_element(into, "results")
    _coefficients(results, facts, version)
    _held(results, facts)
    _verification(results, facts, version)
    _of_readings(results, facts, version)


def _equipment(into: ET.Element, reference: Mapping[str, Any]) -> None:
    add_text(into, "name", reference["item"])
    identification = add_element(add_element(into, "identifications"), "identification")
    add_element(identification, "issuer", "calibrationLaboratory")
    add_element(identification, "value", xml_word(reference["number"]))
    add_text(identification, "name", f"certificate, due {reference['due']}")


def _temperature(into: ET.Element, facts: Mapping[str, Any], version: str) -> None:
    add_text(into, "name", "temperature")
    conditions, k = facts["conditions"], coverage.NORMAL
    measured = (conditions["temperature_degC"], r"\degreecelsius")
    quantity = add_quantity(add_element(into, "data"), "temperature", measured)
    add_uncertainty(quantity, k * conditions["temperature_std_degC"], (k, coverage.PROBABILITY), version)


def _coefficients(results: ET.Element, facts: Mapping[str, Any], version: str) -> None:
    data = _result(results, "coefficients: measured = matrix · true + offset")
    decided = {d["what"]: d for d in facts["decisions"]}
    for c in facts["coefficients"]:
        value, unit = si_value(c["value"], c["unit"])
        quantity = add_quantity(data, c["name"], (value, unit))
        if c["estimated"]:
            expanded = si_value(c["expanded"], c["unit"])[0]
            cover, named = (c["k"], c["coverage_probability"]), not any(c.get(name) for name in DISTRIBUTION)
            add_uncertainty(quantity, expanded, cover, version, named=named)
        if c["name"] in decided:
            _decision(quantity, decided[c["name"]])


def _held(results: ET.Element, facts: Mapping[str, Any]) -> None:
    """What the device held before and after; nothing where it keeps no calibration."""
    for moment, words in (("as_found", "as found"), ("as_left", "as left")):
        held = facts["held"][moment]
        if held is None:
            continue
        data = _result(results, f"calibration of the device {words}")
        kept = [*held["offset"], *(v for row in held["matrix"] for v in row)]
        for c in facts["coefficients"]:
            add_quantity(data, f"{c['name']} {words}", si_value(kept[c["index"]], c["unit"]))


def _verification(results: ET.Element, facts: Mapping[str, Any], version: str) -> None:
    """The error of the device's own output at each position that was measured again."""
    verified = facts["verification"] or {"positions": ()}
    decided = {d["what"]: d for d in facts["decisions"]}
    if not verified["positions"]:
        return
    data = _result(results, "verification: error of the device's own output")
    for position in verified["positions"]:
        what = f"verification {position['name']}"
        quantity = add_quantity(data, what, si_value(position["error"], verified["unit"]))
        if (decision := decided.get(what)) and position["std"] > 0:
            expanded = si_value(decision["expanded"], verified["unit"])[0]
            cover = (decision["expanded"] / position["std"], coverage.PROBABILITY)
            add_uncertainty(quantity, expanded, cover, version)
            _decision(quantity, decision)


def _of_readings(results: ET.Element, facts: Mapping[str, Any], version: str) -> None:
    """What else was limited: residual, noise, tilt, consistency at the worst visit."""
    others = [d for d in facts["decisions"] if d["what"] not in NAMES and not d["what"].startswith(verification.WHAT)]
    if not others:
        return
    data = _result(results, "readings: the worst of all positions")
    for decision in others:
        unit = decision["unit"]
        quantity = add_quantity(data, f"largest {decision['what']}", si_value(decision["value"], unit))
        if wide := decision["expanded"]:
            add_uncertainty(quantity, si_value(wide, unit)[0], (coverage.NORMAL, coverage.PROBABILITY), version)
        _decision(quantity, decision)


def _decision(quantity: ET.Element, decision: Mapping[str, Any]) -> None:
    """The limit in words, and whether the value is accepted."""
    data = add_element(add_element(quantity, "measurementMetaData"), "metaData")
    named = {key: float(decision[key]) for key in ("limit", "guard", "margin")}
    words = "certificate-decided-gain" if decision["what"] in GAIN_NAMES else "certificate-decided"
    unit = "" if decision["unit"] == "1" else f" {decision['unit']}"
    add_text(
        data,
        "declaration",
        render(Message(words, unit=unit, false_accept=format_risk(decision["false_accept"]), **named)),
    )
    add_element(data, "conformity", "pass" if decision["margin"] >= 0 else "fail")


def _result(results: ET.Element, name: str) -> ET.Element:
    one = add_element(results, "result")
    add_text(one, "name", name)
    return add_element(one, "data")
