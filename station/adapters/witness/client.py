"""A witness as a place that keeps a log's head: asked at each opening of the log, shown the log after each load."""

import json
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import Any
from urllib.parse import quote

from station.domain.records.head import SealedHead
from station.domain.records.merkle import Tree
from station.domain.records.tree_head import TreeHead, WitnessReceipt, receipt_statement, replacement_statement
from station.files.json_text import parse_json

#: No answer of a witness is longer.
_MOST_BYTES = 1 << 20


class WitnessRefused(OSError):
    """The witness was reached and did not take the head."""


class WitnessClient:
    """url, public_key (32 bytes): of the witness. verify(key, signature, statement). sign, station_key: the station's.

    Errors of its calls: OSError.
    """

    lags = True

    def __init__(
        self,
        url: str,
        station: str,
        station_key: bytes,
        sign: Callable[[bytes], bytes],
        public_key: bytes,
        verify: Callable[[bytes, bytes, bytes], bool],
        timeout_s: float,
    ) -> None:
        self._url, self._station, self._timeout_s = url.rstrip("/"), station, timeout_s
        self._station_key, self._sign, self._public_key, self._verify = station_key, sign, public_key, verify

    @property
    def name(self) -> str:
        """Where, for a person."""
        return f"witness {self._url}"

    def read(self) -> SealedHead | None:
        """The newest head that the witness has of this station."""
        known = self._newest()
        if known is None:
            return None
        return SealedHead(known.log_id, known.station, known.size, known.seal, known.record_signature)

    def write(self, head: SealedHead, *, durable: bool) -> None:
        """Nothing: a commit does not wait for a network. `submit` is for the pause after a load."""

    def submit(self, head: SealedHead, tree: Tree, replaces: str = "") -> WitnessReceipt:
        """Shows the witness the log up to `head`; its receipt. replaces: end of the log whose place this one takes."""
        known = self._newest()
        earlier = known.size if known and known.log_id == head.log_id else 0
        if earlier > head.number and not replaces:
            raise WitnessRefused(f"it knows {earlier} records")
        root = tree.root(head.number).hex()
        unsigned = TreeHead(
            head.log_id, self._station, head.number, root, head.hash, head.signature, self._station_key.hex()
        )
        signed = TreeHead.of(unsigned.document() | {"signature": self._sign(unsigned.statement()).hex()})
        proof = [step.hex() for step in tree.proof(earlier, head.number)] if earlier and not replaces else []
        word = self._sign(replacement_statement(signed, replaces)).hex() if replaces else ""
        body = {
            "head": signed.document(),
            "earlier": earlier,
            "proof": proof,
            "replaces": replaces,
            "replaces_signature": word,
        }
        answer = self._ask("/heads", body)
        receipt = WitnessReceipt(head.number, root, int(answer["at_ns"]), str(answer["signature"]))
        statement = receipt_statement(signed, receipt.at_ns)
        if not self._verify(self._public_key, bytes.fromhex(receipt.signature), statement):
            raise WitnessRefused("its receipt is not signed by the key in config.yaml")
        return receipt

    def _newest(self) -> TreeHead | None:
        answer = self._ask(f"/heads/{quote(self._station, safe='')}")
        return TreeHead.of(answer["head"]) if answer.get("head") else None

    def _ask(self, path: str, body: dict[str, Any] | None = None) -> dict[str, Any]:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self._url + path, data, {"content-type": "application/json"})
        try:
            with urllib.request.urlopen(request, timeout=self._timeout_s) as answer:
                document = parse_json(answer.read(_MOST_BYTES))
        except urllib.error.HTTPError as error:
            raise WitnessRefused(error.read(1000).decode("utf-8", "replace") or str(error)) from error
        except ValueError as error:
            raise OSError("its answer is no JSON") from error
        if not isinstance(document, dict):
            raise OSError("its answer is no JSON object")
        return document
