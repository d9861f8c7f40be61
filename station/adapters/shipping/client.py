"""A plant as its stations reach it: one connection that is kept, a token or a certificate (RecordReceiver)."""

import http.client
import ssl
from collections.abc import Sequence
from contextlib import suppress
from typing import Any
from urllib.parse import quote, urlsplit

from station.domain.records.wire import WireRecord, encode
from station.files.json_text import parse_json
from station.messages import Message
from station.ports.plant import Claim
from station.ports.shipping import ReceiverAnswer, ReceiverAway

#: No answer of a plant is longer.
_MOST_BYTES = 1 << 20


class PlantClient:
    """tls: the context of https addresses, with the station's certificate where it has one. Errors: OSError."""

    def __init__(self, url: str, token: str, timeout_s: float, tls: ssl.SSLContext | None = None) -> None:
        parts = urlsplit(url)
        self._host, self._port = parts.hostname or "", parts.port
        self._prefix, self._secure = parts.path.rstrip("/"), parts.scheme == "https"
        self._timeout_s, self._tls = timeout_s, tls
        self._headers = {"authorization": f"Bearer {token}"} if token else {}
        self._connection: http.client.HTTPConnection | None = None

    def standing(self, log_id: str) -> ReceiverAnswer:
        """How far it has the log."""
        return _answer(self._ask("GET", f"/logs/{quote(log_id, safe='')}"))

    def seals(self, log_id: str, first: int, last: int) -> list[bytes]:
        """Its seals of records first … last."""
        answer = self._ask("GET", f"/logs/{quote(log_id, safe='')}/seals?first={first}&last={last}")
        try:
            return [bytes.fromhex(seal) for seal in answer["seals"]]
        except (KeyError, TypeError, ValueError) as error:
            raise ReceiverAway(Message("shipping-no-plant", status=200)) from error

    def send(self, log_id: str, records: Sequence[WireRecord], claim: Claim) -> ReceiverAnswer:
        """Hands over records."""
        headers = {"x-log-newest": str(claim.newest), "x-log-seal": claim.seal}
        path = f"/logs/{quote(log_id, safe='')}/records"
        return _answer(self._ask("POST", path, encode(records), headers))

    def close(self) -> None:
        """Gives the connection up; twice is harmless."""
        if self._connection is not None:
            with suppress(OSError):
                self._connection.close()
            self._connection = None

    def _ask(self, method: str, path: str, body: bytes | None = None, headers: Any = None) -> dict[str, Any]:
        kept = self._connection is not None
        try:
            return self._once(method, path, body, headers or {})
        except OSError:
            self.close()
            if not kept:
                raise
        except http.client.HTTPException as error:
            self.close()
            if not kept:
                raise ReceiverAway(Message("shipping-broken-off")) from error
        try:  # the plant may have closed a connection that idled; asking twice is harmless
            return self._once(method, path, body, headers or {})
        except http.client.HTTPException as error:
            self.close()
            raise ReceiverAway(Message("shipping-broken-off")) from error
        except OSError:
            self.close()
            raise

    def _once(self, method: str, path: str, body: bytes | None, headers: dict[str, str]) -> dict[str, Any]:
        if self._connection is None:
            self._connection = self._connect()
        self._connection.request(method, self._prefix + path, body, self._headers | headers)
        response = self._connection.getresponse()
        data = response.read(_MOST_BYTES)
        try:
            document = parse_json(data)
        except ValueError as error:
            raise ReceiverAway(Message("shipping-no-plant", status=response.status)) from error
        if not isinstance(document, dict):
            raise ReceiverAway(Message("shipping-no-plant", status=response.status))
        if response.status >= http.client.INTERNAL_SERVER_ERROR:
            raise ReceiverAway(_why(document, response.status))
        return document

    def _connect(self) -> http.client.HTTPConnection:
        if self._secure:
            return http.client.HTTPSConnection(self._host, self._port, timeout=self._timeout_s, context=self._tls)
        return http.client.HTTPConnection(self._host, self._port, timeout=self._timeout_s)


def _why(document: dict[str, Any], status: int) -> Message:
    """What a plant says that cannot do its work now."""
    try:
        return Message.of(document["message"])
    except (KeyError, TypeError, ValueError):
        text = document.get("error")
        return Message.text(text) if isinstance(text, str) else Message("shipping-no-plant", status=status)


def _answer(document: dict[str, Any]) -> ReceiverAnswer:
    try:
        refused = document.get("refused")
        number, seal = int(document.get("number", 0)), bytes.fromhex(document.get("seal", ""))
        if refused is None:
            return ReceiverAnswer(number, seal)
        message = Message.of(refused["message"])
        return ReceiverAnswer(number, seal, int(refused["number"]), str(refused["reason"]), message)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ReceiverAway(Message("shipping-no-plant", status=200)) from error
