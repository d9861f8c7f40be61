"""A unit's calibration certificate: what it holds, gathered from the log once; HTML and PDF only lay it out."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from station.domain.line_quality import history
from station.domain.product.device_map import DeviceMap
from station.domain.recipe.recipe import Recipe
from station.domain.records import stored_attempt
from station.domain.records.issued_certificate import Edition
from station.ports.store import LogHead
from station.reporting.certificate import dcc, facts, origin_sections, result_sections
from station.reporting.certificate.issue import of_facts
from station.reporting.certificate.issuer import Issuer
from station.reporting.certificate.writer import CertificateTable, SectionWriter
from station.reporting.words import Words


@dataclass(frozen=True, slots=True)
class Certificate:
    """Everything that stands on a certificate, in one language. number: its own, which each page bears; texts: the
    language's; outcome: PASS or FAIL; simulated: the mark across every page where rig and devices were simulated, else
    ''; statements: declarations; mark: with what else it was made (reporting.certificate.issue)."""

    serial: str
    number: str
    outcome: str
    language: str
    texts: Mapping[str, str]
    sections: tuple[CertificateTable, ...]
    simulated: str = ""
    statements: tuple[str, ...] = ()
    mark: str = ""

    @property
    def title(self) -> str:
        """What it is and of which unit."""
        return f"{self.texts['cert_title']} {self.serial}"


def build(
    stored: Mapping[str, Any],
    recipe: Recipe,
    head: LogHead,
    words: Words,
    issuer: Issuer | None = None,
    edition: Edition | None = None,
    receipt: Mapping[str, Any] | None = None,
    device_map: DeviceMap | None = None,
) -> Certificate:
    """The certificate of one ended attempt. stored: everything the log holds of it, with the recipe it used; head: the
    newest record of the log; edition: which certificate of it, left out: the first; receipt: the witness' newest
    countersignature. Errors: LogError where it came to no calibration."""
    first = Edition("", str(stored["ended"] or stored["started"])[:10])
    content = facts.of_attempt(
        *(stored, recipe, head, issuer or Issuer(), edition or first),
        receipt=receipt,
        device_map=device_map,
    )
    w, known = SectionWriter(words), history.of_document(stored_attempt.result(stored, "history"))
    writes = device_map is None or device_map.writes
    sections = (
        origin_sections.issue(w, content),
        origin_sections.item(w, stored),
        *result_sections.result_tables(w, content, stored, recipe, writes),
        *origin_sections.origin_tables(w, content, stored, recipe, known),
    )
    return Certificate(
        serial=str(stored["serial"]),
        number=str(content["number"]),
        outcome=str(content["outcome"]),
        language=words.code,
        texts=w.texts,
        sections=tuple(s for s in sections if s.rows),
        simulated=w.say("certificate-simulated-mark") if content["simulated"] else "",
        statements=tuple(w.render(m) for m in dcc.statements(content)),
        mark=of_facts(content, words.code).mark(),
    )
