"""The work of `station certificate`."""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station import __version__
from station.cli import _output
from station.cli._log_options import open_named_log
from station.config.settings import load_settings
from station.domain.core.types import Outcome
from station.domain.records.issued_certificate import Edition, IssuedFile, digest_of, edition_for, issued_files
from station.domain.records.stored_attempt import utc_day
from station.errors import LogError, ReferenceOverdue, UsageError
from station.files.replace import check_replaceable, replacing
from station.messages import render, system_reason
from station.ports.log_reader import Query
from station.reporting.certificate import dcc, document, facts, signature, wsjf
from station.reporting.certificate.issuer import Issuer
from station.reporting.certificate.pdf import pdf
from station.reporting.words import words_of
from station.service.golden_register import refuse_clock_behind
from station.service.recompute import parse_recipe_and_product
from station.service.witnessed import newest_receipt
from station.wiring.issuing import seal_issued

if TYPE_CHECKING:
    from station.ports.log_reader import Attempt, LogReader


@dataclass(frozen=True, slots=True)
class CertificateFiles:
    """What to write, and how."""

    pdf: Path | None
    xml: Path | None
    json: Path | None
    wsjf: Path | None
    dcc_version: str
    sign_key: Path | None
    sign_cert: Path | None
    language: str
    changed: str = ""

    @property
    def any(self) -> bool:
        """Whether any is to be written."""
        return any((self.pdf, self.xml, self.json, self.wsjf))


def write_certificate(
    serial: str, attempt: str | None, files: CertificateFiles, db: Path | None, config: Path | None
) -> int:
    """Writes the files. Errors: UsageError, LogError, ReferenceOverdue."""
    _check(files)
    with open_named_log(db, config) as log:
        _require_whole(log)
        refuse_clock_behind(log, time.time())
        chosen = _attempt(log, serial, attempt)
        stored = log.attempt(chosen)
        facts.require_certifiable(stored)
        recipe, product, _ = parse_recipe_and_product(*log.recipe_and_product(chosen))
        location = log.location
        head, receipt = log.head(), newest_receipt(log)
    today = utc_day(time.time_ns())
    if late := facts.overdue(recipe, stored["started"]):
        raise ReferenceOverdue("certificate-reference-overdue", item=late[0]["item"], due=late[0]["due"])
    settings = load_settings(config)
    issuer = Issuer.of(settings.certificate.document())
    _require_traceable(issuer, facts.references(recipe))
    outside_log = facts.outside_log(issuer, stored)
    known = [file for _, file in issued_files(stored)]
    edition = _edition(edition_for(known, facts.first_number(stored), outside_log, today), files.changed)
    found = facts.of_attempt(stored, recipe, head, issuer, edition, receipt, product.map)
    made = document.build(stored, recipe, head, words_of(files.language), issuer, edition, receipt, product.map)
    wanted: list[tuple[str, Path | None, Callable[[], bytes]]] = [
        ("pdf", files.pdf, lambda: pdf(made)),
        ("xml", files.xml, lambda: _xml(found, files)),
        ("json", files.json, lambda: _json(found)),
        ("wsjf", files.wsjf, lambda: _json(wsjf.to_wsjf(stored))),
    ]
    # Made before the first is written: where one cannot be made, none is there.
    contents = [(kind, path, make()) for kind, path, make in wanted if path is not None]
    for _, path, _ in contents:
        with _refusal_of(path):
            check_replaceable(path)
    for _, path, content in contents:
        _write(path, content)
        _output.print_line(str(path))
    issued = [
        IssuedFile(edition.number, kind, digest_of(content), edition.issued, __version__, outside_log, edition.changed)
        for kind, _, content in contents
    ]
    if (unsealed := seal_issued(location, settings, chosen.attempt, issued)) is not None:
        _output.print_remark(render(unsealed))
    return 0


def _write(path: Path, content: bytes) -> None:
    with _refusal_of(path), replacing(path) as part:
        part.write_bytes(content)


@contextmanager
def _refusal_of(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as exc:
        raise UsageError("file-not-written", file=str(path), why=system_reason(exc)) from exc


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as exc:
        raise UsageError("file-unreadable", file=str(path), why=system_reason(exc)) from exc


def _check(files: CertificateFiles) -> None:
    if not files.any:
        raise UsageError("certificate-no-file")
    paths = [path for path in (files.pdf, files.xml, files.json, files.wsjf) if path is not None]
    if twice := [path for path in paths if paths.count(path) > 1]:
        raise UsageError("certificate-one-file", file=str(twice[0]))
    if files.dcc_version not in dcc.VERSIONS:
        raise UsageError("certificate-dcc-version", version=files.dcc_version[:20])
    if (files.sign_key is None) != (files.sign_cert is None):
        raise UsageError("certificate-sign-pair")


def _edition(found: Edition, stated: str) -> Edition:
    """With what a person says that it changes, where the log of an older version does not know what it replaces.
    Errors: UsageError."""
    if not found.replaces or found.changed:
        if stated:
            raise UsageError("certificate-change-known")
        return found
    parts = tuple(part.strip() for part in stated.split(",") if part.strip())
    if not parts or not set(parts) <= set(facts.PARTS):
        raise UsageError("certificate-change-unknown", number=found.replaces, parts=facts.PARTS)
    return replace(found, changed=parts)


def _require_traceable(issuer: Issuer, references: Sequence[object]) -> None:
    """UsageError where an accreditation is claimed without what it stands on (ISO/IEC 17025, 6.5 and 7.8.2.1)."""
    if issuer.accreditation and not (references and issuer.laboratory.name and issuer.signatory):
        raise UsageError("certificate-accreditation-bare", number=issuer.accreditation)


def _require_whole(log: "LogReader") -> None:
    """LogError where the log's chain of hashes does not hold."""
    from station.wiring.logs import trust_of

    findings = list(log.findings(trust_of({}, None, Path(log.location), None), lambda _: None))
    if findings:
        raise LogError("certificate-log-broken", log=log.location)


def _attempt(log: "LogReader", serial: str, attempt: str | None) -> "Attempt":
    """The attempt of that id, or the newest that passed, or else the newest."""
    found = log.attempts(Query(serial=serial))
    if attempt is not None:
        found = [a for a in found if a.attempt == attempt]
    if not found:
        raise LogError("log-no-such-attempt-of", log=log.location, serial=serial)
    return next((a for a in found if a.outcome == Outcome.PASS), found[0])


def _xml(found: dict[str, Any], files: CertificateFiles) -> bytes:
    made = dcc.to_xml(found, files.dcc_version)
    if files.sign_key is None or files.sign_cert is None:
        return made
    key, certificate = _read(files.sign_key), _read(files.sign_cert)
    try:
        return signature.sign(made, key, certificate)
    except ValueError as exc:
        names = {"key": str(files.sign_key), "certificate": str(files.sign_cert)}
        raise UsageError("certificate-sign-unusable", **names) from exc


def _json(found: dict[str, Any]) -> bytes:
    return json.dumps(found, ensure_ascii=False, indent=1, allow_nan=False).encode()
