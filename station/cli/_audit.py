"""Answers of `station audit`: gathered as one document, then printed as JSON or for a person."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from station.cli import _audit_text, _output
from station.errors import LogError, UsageError
from station.ports.log_reader import Query

if TYPE_CHECKING:
    from station.domain.records.chain import IntegrityFinding
    from station.ports.log_reader import LogReader

#: Something is wrong with the data: an edited log, or coefficients that do not come out again.
WRONG_DATA_EXIT_CODE = 2


@dataclass(frozen=True, slots=True)
class AuditRequest:
    """What is asked. key: file of the public key; known: seals by number, from a certificate; config: the file
    that names the station's anchors, left out: ./config.yaml where there is one."""

    query: Query
    limit: int | None
    verify: bool
    recompute: bool
    key: Path | None = None
    known: Mapping[int, bytes] = field(default_factory=dict)
    config: Path | None = None

    @property
    def lists(self) -> bool:
        """Whether attempts are asked for, and not the log as a whole."""
        return self.query != Query() or not self.verify or self.recompute


def run_audit(log: "LogReader", request: AuditRequest, *, as_json: bool) -> int:
    """Prints the answer; the exit code. Errors: LogError, UsageError."""
    if request.limit is not None and not request.lists:
        raise UsageError("audit-limit-of-list")
    document: dict[str, Any] = {"schema": "station.audit/1", "log": log.location, "head": asdict(log.head())}
    if request.verify:
        document["verify"] = _verify(log, request)
    if request.lists:
        document |= _attempts(log, request)
    if request.recompute:
        document["recompute"] = _recompute(log, request)
    if as_json:
        _output.print_json(document)
    else:
        _audit_text.print_audit(document)
    whole = not document.get("verify", {}).get("findings")
    same = all(r["agrees"] for r in document.get("recompute", ()))
    return 0 if whole and same else WRONG_DATA_EXIT_CODE


def _verify(log: "LogReader", request: AuditRequest) -> dict[str, Any]:
    from station.config.settings import load_settings
    from station.wiring.logs import trust_of

    here = request.config is not None or Path("config.yaml").is_file()
    trust = trust_of(request.known, request.key, Path(log.location), load_settings(request.config) if here else None)
    head = log.head()
    with _output.progress() as bar:
        task = bar.add_task("checking the chain", total=max(head.number, 1))
        findings = [f.document() for f in log.findings(trust, lambda number: bar.update(task, completed=number))]
    journal, unsealed = _check_journal(log)
    people, edited = _check_accounts(log)
    findings += [f.document() for f in (*unsealed, *edited)]
    anchors = [
        {"place": place, "number": state.number, "state": state.what} for place, state in log.anchors(trust).items()
    ]
    whole = {"records": head.number, "whole": not findings, "findings": findings}
    return {**whole, "anchors": anchors, "acknowledged": log.acknowledgements(), "journal": journal, "accounts": people}


def _check_journal(log: "LogReader") -> tuple[dict[str, int] | None, "Sequence[IntegrityFinding]"]:
    """How far the log vouches for the page's journal beside it, and what is wrong with that; a plant has none."""
    from station.panel_protocol.journal_seal import journal_findings
    from station.wiring.logs import plant_address

    if plant_address(log.location):
        return None, ()
    state, found = journal_findings(log, Path(log.location))
    return asdict(state), found


def _check_accounts(log: "LogReader") -> tuple[dict[str, object] | None, "Sequence[IntegrityFinding]"]:
    """What the log has sealed of the page's accounts, and who is not as sealed; None where it has sealed none."""
    from station.panel_protocol.account_seal import account_findings
    from station.wiring.logs import plant_address

    if plant_address(log.location):
        return None, ()
    seal, found = account_findings(log, Path(log.location))
    return {"file": str(seal.file), "people": len(seal.hashes), "record": seal.number} if seal else None, found


def _attempts(log: "LogReader", request: AuditRequest) -> dict[str, Any]:
    serial = request.query.serial
    if serial is None:
        found = [_row(asdict(a)) for a in log.attempts(request.query, request.limit)]
        why = log.reasons([a["record"] for a in found if a["outcome"] in ("FAIL", "ERROR")])
        listed = [{**a, "reasons": why.get(a["record"], [])} for a in found]
        return {"count": len(found), "attempts": listed}
    from station.service.flash_record import flashes_of

    life, flashes = log.life(request.query, request.limit), flashes_of(log, serial)
    if not life and not flashes:
        raise LogError("log-no-such-attempt-of", log=log.location, serial=serial)
    return {"serial": serial, "count": len(life), "attempts": life, "flashes": flashes}


def _row(attempt: dict[str, Any]) -> dict[str, Any]:
    from station.domain.records.stored_attempt import utc

    ended = attempt["ended_ns"]
    attempt["record"] = attempt.pop("number")
    return {**attempt, "started": utc(attempt["started_ns"]), "ended": None if ended is None else utc(ended)}


def _recompute(log: "LogReader", request: AuditRequest) -> list[dict[str, Any]]:
    from station.service.recompute import recompute

    found = log.attempts(request.query, request.limit)
    with _output.progress() as bar:
        task = bar.add_task("computing again", total=len(found))
        done = []
        for attempt in found:
            done.append(recompute(log, attempt).document())
            bar.advance(task)
    return done
