"""The certificate as a Digital Calibration Certificate (PTB DCC 3.3.0, or 3.2.1), with D-SI units.

Values are SI: offsets of accelerometers in m/s². Numbers are written with all their digits, so that reading them back
gives the same bits.
"""

from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree as ET

from station.domain.records import stored_attempt
from station.messages import Message, render
from station.reporting.certificate.facts import STANDARD_GRAVITY
from station.reporting.certificate.issue import of_facts

DCC, SI = "https://ptb.de/dcc", "https://ptb.de/si"
VERSIONS = ("3.3.0", "3.2.1")
#: D-SI unit and factor of the recipe's units.
UNITS = {
    "g": (r"\metre\second\tothe{-2}", STANDARD_GRAVITY),
    "uT": (r"\micro\tesla", 1.0),
    "deg/s": (r"\degree\second\tothe{-1}", 1.0),
    "deg": (r"\degree", 1.0),
    "1": (r"\one", 1.0),
}
_UNKNOWN = "not stated"


def to_xml(facts: Mapping[str, Any], version: str = VERSIONS[0]) -> bytes:
    """The whole document, UTF-8."""
    ET.register_namespace("dcc", DCC)
    ET.register_namespace("si", SI)
    root = ET.Element(_dcc("digitalCalibrationCertificate"), {"schemaVersion": version})
    if "log" in facts:
        root.append(ET.Comment(of_facts(facts, dcc_version=version).mark()))
    _administrative(_add(root, "administrativeData"), facts)
    _results(_add(root, "measurementResults"), facts, version)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True))


def read_quantities(xml: bytes) -> dict[str, tuple[float, float | None]]:
    """Value and U (None where there is none) of each named quantity of the results, in the units of the document."""
    found = {}
    for quantity in ET.fromstring(xml).iter(_dcc("quantity")):
        name, real = quantity.find(f"{_dcc('name')}/{_dcc('content')}"), quantity.find(_si("real"))
        if name is None or real is None:
            continue
        wide = next((e for e in real.iter() if e.tag in (_si("valueExpandedMU"), _si("uncertainty"))), None)
        value = float(real.findtext(_si("value"), "nan"))
        found[str(name.text)] = (value, None if wide is None else float(str(wide.text)))
    return found


def _administrative(into: ET.Element, facts: Mapping[str, Any]) -> None:
    software = _add(_add(into, "dccSoftware"), "software")
    _text(software, "name", "station")
    _add(software, "release", _word(facts["method"]["software"]))
    core = _add(into, "coreData")
    _add(core, "countryCodeISO3166_1", facts["issuer"]["laboratory"]["country"])
    _add(core, "usedLangCodeISO639_1", "en")
    _add(core, "mandatoryLangCodeISO639_1", "en")
    _add(core, "uniqueIdentifier", _word(facts["number"]))
    _add(core, "beginPerformanceDate", facts["performed"]["began"][:10])
    _add(core, "endPerformanceDate", (facts["performed"]["ended"] or facts["performed"]["began"])[:10])
    _add(core, "performanceLocation", "laboratory")
    _add(core, "issueDate", facts["issued"][:10])
    _items(_add(into, "items"), facts["item"])
    laboratory = _add(into, "calibrationLaboratory")
    if facts["issuer"]["accreditation"]:
        _add(laboratory, "calibrationLaboratoryCode", _word(facts["issuer"]["accreditation"]))
    _party(_add(laboratory, "contact"), facts["issuer"]["laboratory"])
    person = _add(_add(into, "respPersons"), "respPerson")
    _text(_add(person, "person"), "name", facts["issuer"]["signatory"])
    _add(person, "mainSigner", "true")
    _party(_add(into, "customer"), facts["issuer"]["customer"])
    _statements(_add(into, "statements"), facts)


def _items(into: ET.Element, item: Mapping[str, Any]) -> None:
    one = _add(into, "item")
    _text(one, "name", str(item["identity"].get("name") or "sensor"))
    identification = _add(_add(one, "identifications"), "identification")
    _add(identification, "issuer", "manufacturer")
    _add(identification, "value", _word(item["serial"]))
    _text(identification, "name", "serial number")


def _statements(into: ET.Element, facts: Mapping[str, Any]) -> None:
    for message in statements(facts):
        _rich(_add(into, "statement"), "declaration", render(message))
    if receipt := facts.get("log", {}).get("witness"):
        _rich(_add(into, "statement"), "declaration", render(_witnessed(receipt)))
    conformity = _add(into, "statement")
    _rich(conformity, "declaration", str(facts["rule"] or _UNKNOWN))
    _add(conformity, "conformity", "pass" if facts["outcome"] == "PASS" else "fail")


def _witnessed(receipt: Mapping[str, Any]) -> Message:
    shown = {key: str(receipt[key]) for key in ("place", "root", "signature")}
    return Message("certificate-witnessed", size=receipt["size"], at=stored_attempt.utc(receipt["at_ns"]), **shown)


def statements(facts: Mapping[str, Any]) -> list[Message]:
    """What a certificate must declare besides its results."""
    first = [Message("certificate-simulated")] if facts["simulated"] else []
    number = facts["issuer"]["accreditation"]
    accredited = Message("certificate-accredited", number=number) if number else Message("certificate-not-accredited")
    gravity = [Message("certificate-standard-gravity", value=STANDARD_GRAVITY)] if facts["unit"] == "g" else []
    traced = [] if facts["references"] else [Message("certificate-untraceable")]
    coverage = Message("certificate-coverage")
    whole = Message("certificate-in-full")
    return [*first, Message("certificate-item-only"), accredited, *traced, *gravity, coverage, whole]


def _results(list_of_results: ET.Element, facts: Mapping[str, Any], version: str) -> None:
    into = _add(list_of_results, "measurementResult")
    _text(into, "name", "calibration")
    method = _add(_add(into, "usedMethods"), "usedMethod")
    _text(method, "name", f"{facts['method']['name']}: recipe {facts['method']['recipe']}")
    _add(method, "reference", f"version {facts['method']['version']}, {facts['method']['hash']}")
    if facts["references"]:
        equipments = _add(into, "measuringEquipments")
        for reference in facts["references"]:
            _equipment(_add(equipments, "measuringEquipment"), reference)
    temperature = facts["conditions"]["temperature_degC"]
    if temperature is not None:
        condition = _add(_add(into, "influenceConditions"), "influenceCondition")
        _text(condition, "name", "temperature")
        wide = 1.96 * facts["conditions"]["temperature_std_degC"]
        real = _quantity(_add(condition, "data"), "temperature", (temperature, r"\degreecelsius"))
        _uncertainty(real, wide, (1.96, 0.95), version)
    one = _add(_add(into, "results"), "result")
    _text(one, "name", "coefficients: measured = matrix · true + offset")
    data = _add(one, "data")
    for c in facts["coefficients"]:
        unit, factor = UNITS.get(c["unit"], (c["unit"], 1.0))
        real = _quantity(data, c["name"], (c["value"] * factor, unit))
        if c["estimated"]:
            _uncertainty(real, c["expanded"] * factor, (c["k"], c["coverage_probability"]), version)


def _equipment(into: ET.Element, reference: Mapping[str, Any]) -> None:
    _text(into, "name", reference["item"])
    identification = _add(_add(into, "identifications"), "identification")
    _add(identification, "issuer", "calibrationLaboratory")
    _add(identification, "value", _word(reference["number"]))
    _text(identification, "name", f"certificate, due {reference['due']}")


def _quantity(into: ET.Element, name: str, value: tuple[float, str]) -> ET.Element:
    quantity = _add(into, "quantity")
    _text(quantity, "name", name)
    real = ET.SubElement(quantity, _si("real"))
    ET.SubElement(real, _si("value")).text = repr(float(value[0]))
    ET.SubElement(real, _si("unit")).text = value[1]
    return real


def _uncertainty(into: ET.Element, expanded: float, cover: tuple[float, float], version: str) -> None:
    factor, probability = cover
    if version == "3.3.0":
        into = ET.SubElement(ET.SubElement(into, _si("measurementUncertaintyUnivariate")), _si("expandedMU"))
        name = "valueExpandedMU"
    else:
        into, name = ET.SubElement(into, _si("expandedUnc")), "uncertainty"
    ET.SubElement(into, _si(name)).text = repr(float(expanded))
    ET.SubElement(into, _si("coverageFactor")).text = repr(float(factor))
    ET.SubElement(into, _si("coverageProbability")).text = repr(float(probability))
    ET.SubElement(into, _si("distribution")).text = "normal"


def _party(into: ET.Element, party: Mapping[str, Any]) -> None:
    _text(into, "name", party["name"])
    location = _add(into, "location")
    for key, tag in (("street", "street"), ("post_code", "postCode"), ("city", "city")):
        if str(party[key]).strip():
            _add(location, tag, _word(party[key]))
    _add(location, "countryCode", party["country"])


def _text(into: ET.Element, tag: str, words: str) -> None:
    _add(_add(into, tag), "content", _printable(words) or _UNKNOWN).set("lang", "en")


def _rich(into: ET.Element, tag: str, words: str) -> None:
    _text(into, tag, words)


def _word(words: Any) -> str:
    """Text that is not empty and has no blanks at its ends."""
    return " ".join(_printable(str(words)).split()) or _UNKNOWN


def _printable(words: str) -> str:
    """Without what XML cannot hold."""
    return "".join(c if c.isprintable() else " " for c in words).strip()


def _add(into: ET.Element, tag: str, words: str | None = None) -> ET.Element:
    made = ET.SubElement(into, _dcc(tag))
    made.text = words
    return made


def _dcc(tag: str) -> str:
    return f"{{{DCC}}}{tag}"


def _si(tag: str) -> str:
    return f"{{{SI}}}{tag}"
