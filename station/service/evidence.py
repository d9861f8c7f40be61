"""One attempt as one file: what the log keeps of it, frames, settings in full, and the script that checks it."""

import base64
import io
import json
import zipfile
from collections.abc import Iterator, Mapping
from importlib import resources
from typing import Any

from station.domain.core.types import Frames, Outcome
from station.domain.records.framepack.plain import to_bytes
from station.domain.records.stored_attempt import mark_of
from station.ports.log_reader import Attempt, LogReader, LogRecord
from station.reporting.certificate.pdf import pdf
from station.reporting.words import Words
from station.service.certificates import certificate_of
from station.service.witnessed import newest_receipt

SCHEMA = "station.evidence/1"
#: Files of a bundle have one date, so that the same evidence gives the same bytes.
_DATE = (1980, 1, 1, 0, 0, 0)
_DOCUMENTS = {"recipe": "recipe.json", "product": "product.json", "config": "configuration.json"}


def bundle(log: LogReader, attempt: Attempt, words: Words) -> bytes:
    """The ZIP of one ended attempt. Errors: LogError."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in sorted(_files(log, attempt, words)):
            archive.writestr(zipfile.ZipInfo(name, _DATE), data, zipfile.ZIP_DEFLATED)
    return made.getvalue()


def _files(log: LogReader, attempt: Attempt, words: Words) -> Iterator[tuple[str, bytes]]:
    records = log.records(attempt)
    mark = mark_of(attempt.software)
    origin = {"simulated": mark, "head": log.head().hash, "witness": newest_receipt(log)}
    yield "attempt.json", _json({"schema": SCHEMA, **origin, **log.attempt(attempt)})
    yield "records.jsonl", b"".join(_record(r) + b"\n" for r in records)
    visits = [r for r in records if r.kind == "visit"]
    for record, frames in zip(visits, log.frames(attempt), strict=True):
        yield f"frames/{record.number}.bin", to_bytes(frames)
        position = "".join(c if c.isalnum() or c in "-_" else "_" for c in str(record.fields["position"]))
        yield f"frames/{record.number}-{position}.log", _candump(frames, mark or "can0")
    for record in records:
        if record.kind == "document":
            yield _DOCUMENTS[str(record.fields["kind"])], _text(record).encode()
    if attempt.outcome == Outcome.PASS:
        yield "certificate.pdf", pdf(certificate_of(log, attempt, words))
    yield "verify.py", resources.files("station.service").joinpath("evidence_verify.py").read_bytes()
    yield "README.txt", _readme(attempt)


def _text(record: LogRecord) -> str:
    text = record.fields["text"]
    return text if isinstance(text, str) else ""


def _record(record: LogRecord) -> bytes:
    fields = {k: _plain(v) for k, v in record.fields.items()}
    seals = {"previous": record.previous.hex(), "hash": record.hash.hex()}
    signature = record.signature.hex() if record.signature else None
    document = {"number": record.number, "kind": record.kind, **seals, "signature": signature, "fields": fields}
    return json.dumps(document, ensure_ascii=True).encode()


def _plain(value: int | float | str | bytes | None) -> Any:
    """A field as JSON holds it: bytes as base64."""
    return {"base64": base64.b64encode(value).decode()} if isinstance(value, bytes) else value


def _candump(frames: Frames, channel: str) -> bytes:
    """Frames as candump -l writes them, to be read by a person and by other tools."""
    lines = []
    for time_ns, can_id, length, data in zip(frames.time_ns, frames.can_id, frames.length, frames.data, strict=True):
        shown = f"{int(can_id) & 0x1FFFFFFF:08X}" if int(can_id) > 0x7FF else f"{int(can_id):03X}"
        stamp = f"({int(time_ns) // 10**9}.{int(time_ns) % 10**9 // 1000:06d})"
        lines.append(f"{stamp} {channel} {shown}#{bytes(data[: int(length)]).hex().upper()}\n")
    return "".join(lines).encode()


def _readme(attempt: Attempt) -> bytes:
    passed = attempt.outcome == Outcome.PASS
    return (
        ("SIMULATED: rig and device were simulated; no unit was measured.\n\n" if mark_of(attempt.software) else "")
        + f"Evidence of attempt {attempt.attempt} of unit {attempt.serial}: {attempt.outcome}.\n\n"
        "python verify.py        checks every seal and every frame; needs Python 3.9 or later and nothing else\n"
        "attempt.json            everything that the log keeps of the attempt, to be read\n"
        "records.jsonl           the same as sealed records\n"
        "frames/                 raw frames of each visit: as sealed (.bin) and as candump text (.log)\n"
        "recipe.json, product.json, configuration.json   as used\n"
        + ("certificate.pdf         the unit passed\n" if passed else "No certificate: the unit did not pass.\n")
    ).encode()


def _json(document: Mapping[str, Any]) -> bytes:
    return json.dumps(document, ensure_ascii=False, indent=1, default=lambda v: v.hex()).encode()
