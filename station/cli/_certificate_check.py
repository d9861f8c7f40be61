"""The work of `station certificate --check`."""

from pathlib import Path
from typing import TYPE_CHECKING

from station.cli import _output
from station.cli._audit import WRONG_DATA_EXIT_CODE
from station.cli._log_options import open_named_log
from station.config.settings import Settings, load_settings
from station.errors import UsageError
from station.messages import Message, system_reason
from station.service.certificate_check import check_certificate

if TYPE_CHECKING:
    from station.ports.log_reader import LogReader
    from station.reporting.certificate.issue import CertificateIssue

_MOST_BYTES = 16 * 1024 * 1024


def check_file(path: Path, db: Path | None, config: Path | None, key: Path | None) -> int:
    """Says whether a certificate is as the log has it; the exit code. Errors: UsageError, LogError, ConfigError."""
    from station.wiring.logs import trust_of

    data = _read(path)
    here = config is not None or Path("config.yaml").is_file()
    settings = load_settings(config) if here else None
    with open_named_log(db, config) as log:
        checked = check_certificate(data, str(path), log, trust_of({}, key, Path(log.location), settings))
        found = list(checked.findings)
        witnessed = None if found else _witnessed(log, checked.issue, settings)
    issue, issuer = checked.issue, checked.issue.issuer
    if witnessed is not None and witnessed.id == "certificate-check-countersignature":
        found.append(witnessed)
    for message in found:
        _output.print_message(message)
    if found:
        return WRONG_DATA_EXIT_CODE
    whole = Message(
        "certificate-check-good",
        file=str(path),
        serial=issue.serial,
        attempt=issue.attempt,
        number=issue.head.number,
        hash=issue.head.hash,
    )
    _output.print_message(whole)
    for message in checked.remarks:
        _output.print_message(message)
    if witnessed is not None:
        _output.print_message(witnessed)
    if checked.sealed:
        return 0
    named = {"laboratory": issuer.laboratory.name, "customer": issuer.customer.name, "signatory": issuer.signatory}
    shown = {name: text or "–" for name, text in named.items()}
    _output.print_message(Message("certificate-check-beside", issued=issue.issued, **shown))
    return 0


def _witnessed(log: "LogReader", issue: "CertificateIssue", settings: Settings | None) -> Message | None:
    """What the witness' own key says of the countersignature; None where there is none."""
    from station.wiring.countersignature import is_countersigned
    from station.wiring.logs import plant_address

    receipt = issue.receipt
    if receipt is None:
        return None
    if settings is None or settings.witness is None or plant_address(log.location):
        return Message("certificate-check-unwitnessed")
    if not is_countersigned(Path(log.location), settings.station, settings.witness, receipt):
        return Message("certificate-check-countersignature")
    return Message("certificate-check-witnessed", place=str(receipt["place"]), size=int(receipt["size"]))


def _read(path: Path) -> bytes:
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise UsageError("certificate-check-none", file=str(path))
        return path.read_bytes()
    except OSError as exc:
        raise UsageError("file-unreadable", file=str(path), why=system_reason(exc)) from exc
