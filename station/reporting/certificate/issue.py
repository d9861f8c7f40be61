"""What a certificate was made with beside its attempt, in a mark that it bears: so it can be made again and compared.

The mark is not trusted. Head and countersignature are compared with the log; date and issuer no log knows.
"""

import base64
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from station.domain.records.issued_certificate import Edition
from station.ports.store import LogHead
from station.reporting.certificate.facts import SCHEMA
from station.reporting.certificate.issuer import Issuer

_NAME = "station.certificate-issue/1"
_MARK = re.compile(rf"{re.escape(_NAME)} ([A-Za-z0-9+/]+=*)".encode())


@dataclass(frozen=True, slots=True)
class CertificateIssue:
    """serial, attempt: whose; issued: ISO date; head: of the log then; receipt: the witness' newest then, or None;
    number, replaces, changed: see Edition; number is '' in older files."""

    serial: str
    attempt: str
    issued: str
    head: LogHead
    issuer: Issuer
    receipt: Mapping[str, Any] | None = None
    language: str = "en"
    dcc_version: str = ""
    number: str = ""
    replaces: str = ""
    changed: tuple[str, ...] = ()

    @property
    def edition(self) -> Edition:
        """Which certificate of its attempt it says to be."""
        return Edition(self.number, self.issued, self.replaces, self.changed)

    def mark(self) -> str:
        """As a PDF and a DCC bear it: letters, digits, + / = alone."""
        return f"{_NAME} {base64.b64encode(json.dumps(asdict(self), sort_keys=True).encode()).decode()}"


def of_facts(facts: Mapping[str, Any], language: str = "en", dcc_version: str = "") -> CertificateIssue:
    """With what the certificate of these facts is made. Errors: KeyError, TypeError where they are none."""
    if facts["schema"] != SCHEMA:
        raise KeyError(SCHEMA)
    issuer = {key: value for key, value in facts["issuer"].items() if key != "laboratory_address"}
    log = facts["log"]
    return CertificateIssue(
        str(facts["item"]["serial"]),
        str(log["attempt"]),
        str(facts["issued"]),
        LogHead(int(log["head"]["number"]), str(log["head"]["hash"])),
        Issuer.of(issuer),
        log["witness"],
        language,
        dcc_version,
        str(facts["number"]),
        str(facts.get("replaces", "")),
        tuple(map(str, facts.get("changed", ()))),
    )


def find_mark(data: bytes) -> CertificateIssue | None:
    """The mark that a PDF or DCC bears; None for another file. Errors: ValueError, KeyError, TypeError."""
    found = _MARK.findall(data)
    if len(found) != 1:
        return None
    document = json.loads(base64.b64decode(found[0], validate=True))
    head, issuer = LogHead(**document.pop("head")), Issuer.of(document.pop("issuer"))
    changed = tuple(map(str, document.pop("changed", ())))
    return CertificateIssue(head=head, issuer=issuer, changed=changed, **document)
