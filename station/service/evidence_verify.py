"""Checks this bundle with Python alone: python verify.py [BUNDLE.zip]. Nothing of the station is needed.

Every record of the log stands in records.jsonl with its seal. A seal is SHA-256(seal of the record before it, then the
record's canonical bytes): kind, then name, type, length and value of each field that is not null. Frames, recipe,
product and settings are checked against the hashes that sealed records hold. What this cannot show is that the log was
not made anew as a whole: compare the seal printed below with the head of the log, an anchor or a certificate.
"""

import base64
import hashlib
import json
import struct
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

Read = Callable[[str], bytes]


def canonical(kind: str, fields: dict[str, Any]) -> bytes:
    """The bytes of a record that are sealed."""
    parts = [b"%d:%b" % (len(kind), kind.encode())]
    for name, value in fields.items():
        if value is None:
            continue
        if isinstance(value, dict):
            tag, body = b"b", base64.b64decode(value["base64"])
        elif isinstance(value, int):
            tag, body = b"i", str(value).encode()
        elif isinstance(value, float):
            tag, body = b"f", struct.pack(">d", value)
        else:
            tag, body = b"s", str(value).encode("utf-8", "surrogateescape")
        parts.append(b"%b=%b%d:%b" % (name.encode(), tag, len(body), body))
    return b"".join(parts)


def check(read: Read) -> Iterator[str]:
    """What is wrong, one sentence each."""
    records = [json.loads(line) for line in read("records.jsonl").decode().splitlines()]
    yield from _seals(records)
    yield from _frames(records, read)
    yield from _documents(records, read)


def _seals(records: list[dict[str, Any]]) -> Iterator[str]:
    before: dict[int, str] = {}
    for record in sorted(records, key=lambda r: int(r["number"])):
        number, previous = record["number"], record["previous"]
        made = hashlib.sha256(bytes.fromhex(previous) + canonical(record["kind"], record["fields"])).hexdigest()
        if made != record["hash"]:
            yield f"record {number} ({record['kind']}) does not give its seal: it was edited"
        if number - 1 in before and before[number - 1] != previous:
            yield f"record {number} does not follow from record {number - 1}"
        before[number] = record["hash"]
    if not records:
        yield "records.jsonl holds no record"


def _frames(records: list[dict[str, Any]], read: Read) -> Iterator[str]:
    for record in records:
        if record["kind"] != "visit":
            continue
        name = f"frames/{record['number']}.bin"
        if hashlib.sha256(read(name)).hexdigest() != record["fields"]["frames_sha256"]:
            yield f"{name} is not what record {record['number']} has sealed"


def _documents(records: list[dict[str, Any]], read: Read) -> Iterator[str]:
    files = {"recipe": "recipe.json", "product": "product.json", "config": "configuration.json"}
    for record in records:
        if record["kind"] == "document":
            name, text = files[record["fields"]["kind"]], record["fields"]["text"].encode()
            if hashlib.sha256(text).hexdigest() != record["fields"]["sha256"] or read(name) != text:
                yield f"{name} is not what record {record['number']} has sealed"


def check_bundle(words: list[str]) -> int:
    """0 where everything agrees, 1 otherwise."""
    place = Path(words[1]) if len(words) > 1 else Path(__file__).parent
    if place.is_dir():
        found = list(check(lambda name: (place / name).read_bytes()))
        records = (place / "records.jsonl").read_bytes()
    else:
        with zipfile.ZipFile(place) as bundle:
            found, records = list(check(bundle.read)), bundle.read("records.jsonl")
    for sentence in found:
        print(sentence)  # noqa: T201 - it has no other face
    last = max((json.loads(line) for line in records.decode().splitlines()), key=lambda r: int(r["number"]))
    state = "WRONG" if found else "whole"
    print(f"{state}: {len(records.splitlines())} records; the last one's seal is {last['number']}:{last['hash']}")  # noqa: T201
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(check_bundle(sys.argv))
