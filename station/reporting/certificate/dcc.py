"""The certificate as a Digital Calibration Certificate (PTB DCC 3.3.0, or 3.2.1), with D-SI units.

Values are SI: offsets of accelerometers in m/s². Numbers are written with all their digits, so that reading them back
gives the same bits.
"""

from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree as ET

from station.domain.records import stored_attempt
from station.messages import Message, render
from station.reporting.certificate.dcc_elements import (
    DCC,
    SI,
    UNKNOWN,
    add_element,
    add_text,
    dcc_tag,
    si_tag,
    xml_word,
)
from station.reporting.certificate.dcc_results import add_results
from station.reporting.certificate.facts import DISTRIBUTION, STANDARD_GRAVITY
from station.reporting.certificate.issue import of_facts

VERSIONS = ("3.3.0", "3.2.1")


def to_xml(facts: Mapping[str, Any], version: str = VERSIONS[0]) -> bytes:
    """The whole document, UTF-8."""
    ET.register_namespace("dcc", DCC)
    ET.register_namespace("si", SI)
    root = ET.Element(dcc_tag("digitalCalibrationCertificate"), {"schemaVersion": version})
    if "log" in facts:
        root.append(ET.Comment(of_facts(facts, dcc_version=version).mark()))
    _administrative(add_element(root, "administrativeData"), facts)
    add_results(add_element(root, "measurementResults"), facts, version)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True))


def read_quantities(xml: bytes) -> dict[str, tuple[float, float | None]]:
    """Value and U (None where there is none) of each named quantity of the results, in the units of the document."""
    found = {}
    for quantity in ET.fromstring(xml).iter(dcc_tag("quantity")):
        name, real = quantity.find(f"{dcc_tag('name')}/{dcc_tag('content')}"), quantity.find(si_tag("real"))
        if name is None or real is None:
            continue
        wide = next((e for e in real.iter() if e.tag in (si_tag("valueExpandedMU"), si_tag("uncertainty"))), None)
        value = float(real.findtext(si_tag("value"), "nan"))
        found[str(name.text)] = (value, None if wide is None else float(str(wide.text)))
    return found


def _administrative(into: ET.Element, facts: Mapping[str, Any]) -> None:
    software = add_element(add_element(into, "dccSoftware"), "software")
    add_text(software, "name", "station")
    add_element(software, "release", xml_word(facts["method"]["software"]))
    core = add_element(into, "coreData")
    add_element(core, "countryCodeISO3166_1", facts["issuer"]["laboratory"]["country"])
    add_element(core, "usedLangCodeISO639_1", "en")
    add_element(core, "mandatoryLangCodeISO639_1", "en")
    add_element(core, "uniqueIdentifier", xml_word(facts["number"]))
    add_element(core, "beginPerformanceDate", facts["performed"]["began"][:10])
    add_element(core, "endPerformanceDate", (facts["performed"]["ended"] or facts["performed"]["began"])[:10])
    add_element(core, "performanceLocation", facts["issuer"].get("place", "laboratory"))
    add_element(core, "issueDate", facts["issued"][:10])
    if facts.get("replaces"):
        change = add_element(core, "reportAmendedSubstituted")
        add_element(change, "typeOfChange", "substituted")
        add_element(change, "replacedUniqueIdentifier", xml_word(facts["replaces"]))
    _items(add_element(into, "items"), facts["item"])
    laboratory = add_element(into, "calibrationLaboratory")
    if is_accredited(facts):
        add_element(laboratory, "calibrationLaboratoryCode", xml_word(facts["issuer"]["accreditation"]))
    _party(add_element(laboratory, "contact"), facts["issuer"]["laboratory"])
    person = add_element(add_element(into, "respPersons"), "respPerson")
    add_text(add_element(person, "person"), "name", facts["issuer"]["signatory"])
    add_element(person, "mainSigner", "true")
    _party(add_element(into, "customer"), facts["issuer"]["customer"])
    _statements(add_element(into, "statements"), facts)


def _items(into: ET.Element, item: Mapping[str, Any]) -> None:
    one = add_element(into, "item")
    add_text(one, "name", str(item["identity"].get("name") or "sensor"))
    identification = add_element(add_element(one, "identifications"), "identification")
    add_element(identification, "issuer", "manufacturer")
    add_element(identification, "value", xml_word(item["serial"]))
    add_text(identification, "name", "serial number")


def _statements(into: ET.Element, facts: Mapping[str, Any]) -> None:
    for message in statements(facts):
        add_text(add_element(into, "statement"), "declaration", render(message))
    if receipt := facts.get("log", {}).get("witness"):
        add_text(add_element(into, "statement"), "declaration", render(_witnessed(receipt)))
    conformity = add_element(into, "statement")
    add_text(conformity, "declaration", str(facts["rule"] or UNKNOWN))
    add_element(conformity, "conformity", "pass" if facts["outcome"] == "PASS" else "fail")


def _witnessed(receipt: Mapping[str, Any]) -> Message:
    shown = {key: str(receipt[key]) for key in ("place", "root", "signature")}
    return Message("certificate-witnessed", size=receipt["size"], at=stored_attempt.utc(receipt["at_ns"]), **shown)


def is_accredited(facts: Mapping[str, Any]) -> bool:
    """What was simulated is no calibration, whatever the laboratory is accredited for."""
    return bool(facts["issuer"]["accreditation"]) and not facts["simulated"]


def statements(facts: Mapping[str, Any]) -> list[Message]:
    """What a certificate must declare besides its results."""
    first = [Message("certificate-simulated")] if facts["simulated"] else []
    number, replaced = facts["issuer"]["accreditation"], facts.get("replaces", "")
    if replaced:
        changed = [Message(f"certificate-{key}") for key in facts["changed"]]
        first.append(
            Message("certificate-replaces", number=replaced, changed=changed or [Message("certificate-not-stated")])
        )
    known = is_accredited(facts)
    accredited = Message("certificate-accredited", number=number) if known else Message("certificate-not-accredited")
    gravity = [Message("certificate-standard-gravity", value=STANDARD_GRAVITY)] if facts["unit"] == "g" else []
    traced = [Message("certificate-traceable" if facts["references"] else "certificate-untraceable")]
    mixed = any(c.get(name) for c in facts["coefficients"] for name in DISTRIBUTION)
    coverage = Message("certificate-coverage-mixed" if mixed else "certificate-coverage")
    whole = Message("certificate-in-full")
    return [*first, Message("certificate-item-only"), accredited, *traced, *gravity, coverage, whole]


def _party(into: ET.Element, party: Mapping[str, Any]) -> None:
    add_text(into, "name", party["name"])
    location = add_element(into, "location")
    for key, tag in (("street", "street"), ("post_code", "postCode"), ("city", "city")):
        if str(party[key]).strip():
            add_element(location, tag, xml_word(party[key]))
    add_element(location, "countryCode", party["country"])
