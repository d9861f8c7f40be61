"""A server of frame templates over a simulated device's objects."""

from collections.abc import Mapping

from station.adapters.simulated_device.object_server import SdoRequest
from station.adapters.simulated_device.objects import SimulatedObjects
from station.adapters.simulated_device.sdo_serving import SdoAbort
from station.domain.product.access import TemplateAccess, TemplateExchange
from station.domain.product.frame_pattern import parse_pattern
from station.domain.product.object_dictionary import Address
from station.domain.product.writeback import LOAD, SAVE

_TOO_LONG = 0x06070012


class TemplateServer:
    """node: what the field `node` of a pattern holds."""

    def __init__(self, objects: SimulatedObjects, access: TemplateAccess, node: int) -> None:
        self._objects, self._access, self._node = objects, access, bytes([node])
        self._restart = False
        self._last: tuple[TemplateExchange, Mapping[str, bytes]] = (access.read, {})

    def reset(self) -> None:
        """Nothing is under way between two frames."""
        self._restart = False

    def wants_restart(self) -> bool:
        """Whether the last request was a reset."""
        requested, self._restart = self._restart, False
        return requested

    def about(self, data: bytes) -> SdoRequest:
        """What a request is about; one that no template knows is about nothing."""
        name, values = self._which(data)
        access = "read" if name == "read" else "write"
        return SdoRequest(*self._address(name, values), access, starts=True, segment=False)

    def handle(self, data: bytes) -> tuple[bytes, ...]:
        """The answer to one request; none where no template knows it, or it is refused and no refusal is written."""
        name, values = self._which(data)
        if name is None:
            return ()
        exchange: TemplateExchange = getattr(self._access, name)
        self._last = exchange, values
        try:
            value = self._serve(name, self._address(name, values), values.get("value", b""))
        except SdoAbort as abort:
            refusal = self.abort(abort.code)
            return (refusal,) if refusal else ()
        return (parse_pattern(exchange.answer).fill({**values, "node": self._node, "value": value}),)

    def refuse(self, data: bytes, code: int) -> bytes:
        """The refusal of a request that is not served."""
        name, values = self._which(data)
        self._last = getattr(self._access, name or "read"), values
        return self.abort(code)

    def abort(self, code: int) -> bytes:
        """The refusal of the last request; empty where the protocol has none."""
        exchange, values = self._last
        if exchange.refused is None:
            return b""
        return parse_pattern(exchange.refused).fill({**values, "node": self._node, "code": code.to_bytes(4, "little")})

    def of_other_object(self, answer: bytes, index: int) -> bytes:
        """The same answer for another index, where the answer names one."""
        pattern = parse_pattern(self._last[0].answer)
        found = pattern.match(answer)
        return answer if found is None else pattern.fill({**found, "index": (index & 0xFFFF).to_bytes(2, "little")})

    def of_next_object(self, answer: bytes) -> bytes:
        """The same answer for the next sub-index, where the answer names one."""
        pattern = parse_pattern(self._last[0].answer)
        found = pattern.match(answer)
        if found is None or "sub" not in found:
            return answer
        return pattern.fill({**found, "sub": bytes([(found["sub"][0] + 1) & 0xFF])})

    def _which(self, data: bytes) -> tuple[str | None, Mapping[str, bytes]]:
        for name in ("save", "restore", "reset", "write", "read"):
            exchange: TemplateExchange | None = getattr(self._access, name)
            if exchange is not None and (values := parse_pattern(exchange.send).match(data)) is not None:
                return name, values
        return None, {}

    def _address(self, name: str | None, values: Mapping[str, bytes]) -> Address:
        command = {"save": self._objects.map.save, "restore": self._objects.map.restore}.get(name or "")
        if command is not None:
            return command.address
        return int.from_bytes(values.get("index", b""), "little"), int.from_bytes(values.get("sub", b""), "little")

    def _serve(self, name: str, at: Address, value: bytes) -> bytes:
        if name == "read":
            found = self._objects.read(*at)
            if len(found) > parse_pattern(self._access.read.answer).width("value"):
                raise SdoAbort(_TOO_LONG)
            return found
        if name == "reset":
            self._restart = True
        elif name in ("save", "restore"):
            self._objects.write(*at, SAVE if name == "save" else LOAD)
        else:
            entry = self._objects.dictionary.entries.get(at)
            own = value if entry is None or entry.size is None else value[: entry.size]
            self._objects.check(*at, len(own))
            self._objects.write(*at, own)
        return value
