"""A certificate's file against the log: known by its SHA-256, or made again from the log's own records, and compared.

A file is made of its attempt, the log's head and the witness' countersignature of that day, and of what no log knows:
date, laboratory, customer, signatory. Head and countersignature must be the log's. Bytes that the log sealed when they
were issued are good, whatever another version of the program makes of the same records; what differs is a remark then.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any
from xml.etree import ElementTree as ET

from station import __version__
from station.domain.records.issued_certificate import (
    IssuedFile,
    changed_parts,
    digest_of,
    edition_of,
    issued_files,
)
from station.domain.records.tree_head import WITNESSED_EVENT
from station.errors import StationError, UsageError
from station.files.json_text import NOT_AS_EXPECTED, parse_json
from station.messages import Message, Value
from station.ports.log_reader import Attempt, LogReader, Query, Trust
from station.ports.store import LogHead
from station.reporting.certificate import dcc, document, facts
from station.reporting.certificate.issue import CertificateIssue, find_mark, of_facts
from station.reporting.certificate.issuer import Issuer
from station.reporting.certificate.pdf import pdf
from station.reporting.words import words_of
from station.service.recompute import parse_recipe_and_product

#: So many differences are listed; an altered unit alters many.
_MOST_LISTED = 20
#: More countersignatures than any log holds.
_ALL = 1 << 40
#: Most characters of a place that are shown.
_MOST_PLACE = 120
_FORMATS = {"pdf": "PDF", "xml": "DCC", "json": "JSON", "wsjf": "WSJF"}
_SIGNATURE = "{http://www.w3.org/2000/09/xmldsig#}Signature"


@dataclass(frozen=True, slots=True)
class CheckedCertificate:
    """kind: json, xml or pdf; issue: what the file says that it was made with; findings: what is wrong, or nothing;
    remarks: that the log sealed this file or others, and what this version would make otherwise; sealed: the log has
    its SHA-256, or digests of what no log knows, so that nothing in it is the file's own word."""

    kind: str
    issue: CertificateIssue
    findings: tuple[Message, ...]
    remarks: tuple[Message, ...] = ()
    sealed: bool = False


def check_certificate(data: bytes, file: str, log: LogReader, trust: Trust) -> CheckedCertificate:
    """What in a certificate is not as the log has it. trust: beside what the certificate itself knows of the log.

    Errors: UsageError where the file is no certificate that can be checked; LogError.
    """
    kind, issue = _recognise(data, file)
    broken = [f.message for f in log.findings(_with_head(trust, issue.head), lambda _: None)]
    if broken:
        return CheckedCertificate(kind, issue, (Message("certificate-check-log", count=len(broken)), *_listed(broken)))
    found = list(_witness(log, issue))
    attempt = _attempt(log, issue)
    if attempt is None:
        unknown = Message("certificate-check-attempt", attempt=issue.attempt[:40], serial=issue.serial[:64])
        return CheckedCertificate(kind, issue, (*found, unknown))
    stored = log.attempt(attempt)
    known = [(record, one) for record, one in issued_files(stored) if one.format == kind]
    differs = list(_content(data, kind, issue, stored, log.recipe_and_product(attempt)))
    sealed = next(((record, one) for record, one in known if one.sha256 == digest_of(data)), None)
    if sealed is not None:
        return CheckedCertificate(kind, issue, tuple(found), tuple(_issued(*sealed, differs)), sealed=True)
    found += _edition(issue, stored)
    others: dict[str, Value] = {"count": len(known), "format": _FORMATS[kind]}
    if known and not differs and not found:
        copy = Message("certificate-check-other-copy", **others)
        return CheckedCertificate(kind, issue, tuple(found), (copy,), sealed=_is_known(issue, stored))
    if known and differs:
        found.append(Message("certificate-check-not-issued", **others))
    return CheckedCertificate(kind, issue, tuple(_listed([*found, *differs])))


def _listed(found: Sequence[Message]) -> list[Message]:
    """The first ones, and how many more."""
    rest = len(found) - _MOST_LISTED
    return [*found[:_MOST_LISTED], *([Message("certificate-check-more", count=rest)] if rest > 0 else [])]


def _attempt(log: LogReader, issue: CertificateIssue) -> Attempt | None:
    """The certificate's; None where the log has none such."""
    return next((a for a in log.attempts(Query(serial=issue.serial)) if a.attempt == issue.attempt), None)


def _issued(record: int, file: IssuedFile, differs: Sequence[Message]) -> Iterator[Message]:
    """That the file was issued so, and what this version makes of the same records."""
    made: dict[str, Value] = {"format": _FORMATS[file.format], "issued": file.issued, "software": file.software}
    yield Message("certificate-check-issued", **made, number=record)
    if differs:
        yield Message("certificate-check-remade", software=__version__, count=len(differs))
        yield differs[0]


def _recognise(data: bytes, file: str) -> tuple[str, CertificateIssue]:
    kind = "pdf" if data.startswith(b"%PDF-") else "xml" if data.lstrip().startswith(b"<") else "json"
    try:
        issue = of_facts(_parse_once(data)) if kind == "json" else find_mark(data)
        if kind == "xml":
            _refuse_entities(data)
        if issue is not None and len(bytes.fromhex(issue.head.hash)) == 32 and issue.head.number > 0:
            words_of(issue.language)
            return kind, issue
    except (*NOT_AS_EXPECTED, RecursionError, StationError, ET.ParseError):
        pass
    raise UsageError("certificate-check-none", file=file)


def _refuse_entities(data: bytes) -> None:
    """A DCC has no document type: its entities could stand for anything. Errors: ValueError, ParseError."""
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ValueError("a document type")
    ET.fromstring(data)


def _parse_once(data: bytes) -> Any:
    """JSON in which no key stands twice: readers differ in which of the two they take. Errors: ValueError."""

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) != len(pairs):
            raise ValueError("a key stands twice")
        return found

    parse_json(data)  # refuses what is too deep or no number
    return json.loads(data, object_pairs_hook=once)


def _with_head(trust: Trust, head: LogHead) -> Trust:
    return Trust({**trust.known, head.number: bytes.fromhex(head.hash)}, trust.public_key, trust.anchors)


def _witness(log: LogReader, issue: CertificateIssue) -> Iterator[Message]:
    """The countersignature must be the one that was the log's newest at that head."""
    events = [e for e in log.station_events(WITNESSED_EVENT, _ALL) if e.number <= issue.head.number]
    known = None
    if events:
        stored = json.loads(events[-1].detail)
        known = {key: stored[key] for key in ("place", "size", "root", "at_ns", "signature")}
    if known != (None if issue.receipt is None else dict(issue.receipt)):
        yield Message("certificate-check-witness", number=events[-1].number if events else 0)


def _content(
    data: bytes, kind: str, issue: CertificateIssue, stored: Mapping[str, Any], texts: tuple[str, str]
) -> Iterator[Message]:
    """What differs from the certificate that the log makes. texts: recipe and product as used."""
    facts.require_certifiable(stored)
    stored = _as_then(stored, issue)
    recipe, product, _ = parse_recipe_and_product(*texts)
    context = (issue.issuer, issue.edition, issue.receipt, product.map)
    if kind == "pdf":
        made = document.build(stored, recipe, issue.head, words_of(issue.language), *context)
        if pdf(made) != data:
            yield Message("certificate-check-bytes")
        return
    found = facts.of_attempt(stored, recipe, issue.head, *context)
    if kind == "json":
        rebuilt = json.loads(json.dumps(found))
        yield from _differences(dict(_leaves(_parse_once(data))), dict(_leaves(rebuilt)))
    else:
        yield from _xml_differences(_texts(data), _texts(dcc.to_xml(found, issue.dcc_version)))


def _as_then(stored: Mapping[str, Any], issue: CertificateIssue) -> Mapping[str, Any]:
    """Signatures of later are not on it."""
    return {**stored, "events": [e for e in stored["events"] if e["record"] <= issue.head.number]}


def _is_known(issue: CertificateIssue, stored: Mapping[str, Any]) -> bool:
    """Whether the log keeps digests of what the certificate says beside the log."""
    return any(file.number == issue.number and file.outside_log for _, file in issued_files(stored))


def _edition(issue: CertificateIssue, stored: Mapping[str, Any]) -> Iterator[Message]:
    """What in number, date and issuer is otherwise than it was issued, as far as the log keeps that."""
    known = [file for _, file in issued_files(stored)]
    first = facts.first_number(stored)
    number = issue.number or first
    file = next((f for f in known if f.number == number), None)
    if file is None:
        if number != first or issue.replaces:
            yield Message("certificate-check-number", number=number[:80])
        return
    if not file.outside_log or issue.issuer == Issuer():
        return  # an older version kept neither; the page's copies name no issuer
    edition = edition_of(known, number)
    if edition != issue.edition:
        yield Message("certificate-check-edition", number=number, issued=file.issued)
    for part in changed_parts(file.outside_log, facts.outside_log(issue.issuer, _as_then(stored, issue))):
        yield Message("certificate-check-part", number=number, what=Message(f"certificate-{part}"))


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Every value with its place, as JSON writes it: 1 is not true, and 0 not −0."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _leaves(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and value:
        for number, inner in enumerate(value):
            yield from _leaves(inner, f"{path}[{number}]")
    else:
        yield path, json.dumps(value, ensure_ascii=False)


def _differences(stated: Mapping[str, str], known: Mapping[str, str]) -> Iterator[Message]:
    for path in dict.fromkeys((*stated, *known)):
        if stated.get(path) != known.get(path):
            yield _differs(path, stated.get(path, ""), known.get(path, ""))


def _texts(xml: bytes) -> list[tuple[str, str]]:
    """Every element's path, attributes and text, in order, but for the signature in it. Errors: UsageError."""
    root = ET.fromstring(xml)
    for signature in root.findall(_SIGNATURE):
        root.remove(signature)
    return list(_elements(root, ""))


def _elements(element: ET.Element, path: str) -> Iterator[tuple[str, str]]:
    own = f"{path}/{element.tag.rpartition('}')[2]}"
    attributes = "".join(f" {name}={value}" for name, value in sorted(element.attrib.items()))
    yield f"{own}", f"{element.tag}{attributes} {(element.text or '').strip()} {(element.tail or '').strip()}".strip()
    for inner in element:
        yield from _elements(inner, own)


def _xml_differences(stated: Sequence[tuple[str, str]], known: Sequence[tuple[str, str]]) -> Iterator[Message]:
    for one, other in zip_longest(stated, known, fillvalue=("", "")):
        if one != other:
            yield _differs(one[0] or other[0], _shown(one[1]), _shown(other[1]))


def _shown(text: str) -> str:
    return text.partition("}")[2].partition(" ")[2] or text


def _differs(where: str, stated: str, known: str) -> Message:
    if len(where) > _MOST_PLACE:
        where = "…/" + where[-_MOST_PLACE:].partition("/")[2]
    return Message("certificate-check-differs", where=where, stated=stated[:80], known=known[:80])
