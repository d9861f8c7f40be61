"""A vendor's protocol by frame templates: what is sent and what answers it, as the product's map writes it."""

from collections.abc import Generator, Mapping, Sequence

from station.adapters.object_access.request import Answer, ObjectRefusal, ObjectRequest
from station.domain.product.access import TemplateAccess, TemplateExchange
from station.domain.product.frame_pattern import parse_pattern
from station.messages import Message

Address = tuple[int, int]
_DEVICE_TYPE = (0x1000, 0)


class TemplateProtocol:
    """sizes: bytes of the objects that are shorter than a frame's value; commands: objects that stand for save and
    restore, by name; readable: objects that the device has, as far as the product names them. A device that does not
    refuse is asked for no other: its silence would say nothing. A template has no unlocking of its own: `unlock` of
    the map is a write."""

    pending_s = 0.0

    def __init__(
        self,
        access: TemplateAccess,
        node: int,
        sizes: Mapping[Address, int],
        commands: Mapping[Address, str],
        readable: Sequence[Address],
    ) -> None:
        self._access, self._node, self._readable = access, bytes([node & 0xFF]), tuple(readable)
        self._sizes, self._commands = dict(sizes), dict(commands)

    def read(self, index: int, sub: int) -> ObjectRequest | None:
        """The exchange that reads; None where only silence could tell that there is no such object."""
        if self._access.read.refused is None and (index, sub) not in self._readable:
            return None
        return self._request(self._access.read, (index, sub))

    def write(self, index: int, sub: int, data: bytes) -> ObjectRequest | None:
        """The exchange that writes, or that of a command; None where the frame has no room for the value."""
        command = self._commands.get((index, sub))
        exchange = None if command is None else getattr(self._access, command)
        if exchange is None:
            exchange = self._access.write
            if len(data) > parse_pattern(exchange.send).width("value"):
                return None
        return self._request(exchange, (index, sub), data)

    def reset(self) -> ObjectRequest:
        """The exchange that resets."""
        return self._request(self._access.reset, (0, 0))

    def alive(self) -> ObjectRequest:
        """Reads the first object that the device is known to have."""
        return self._request(self._access.read, self._readable[0] if self._readable else _DEVICE_TYPE)

    def unlocking(self) -> Generator[ObjectRequest, bytes, None]:
        """Nothing."""
        yield from ()

    def _request(self, exchange: TemplateExchange, at: Address, data: bytes = b"") -> ObjectRequest:
        index, sub = at[0].to_bytes(2, "little"), bytes([at[1]])
        values = {"index": index, "sub": sub, "node": self._node, "value": data}
        answer = parse_pattern(exchange.answer)
        refused = None if exchange.refused is None else parse_pattern(exchange.refused)

        def judge(payload: bytes) -> Answer:
            if refused is not None and (found := refused.match(payload)) is not None and _fits(found, values):
                code = int.from_bytes(found.get("code", b""), "little")
                return ObjectRefusal(code, Message("template-refused"))
            found = answer.match(payload)
            if found is None or not _fits(found, values):
                return None
            value = found.get("value", b"")
            return value[: self._sizes.get(at, len(value))]

        return ObjectRequest(parse_pattern(exchange.send).fill(values), judge)


def template_written(access: TemplateAccess, data: bytes) -> Address | None:
    """The object that a request writes; (0, 0) for a save or a reset; None for one that only reads."""
    for name in ("save", "restore", "reset"):
        command: TemplateExchange | None = getattr(access, name)
        if command is not None and parse_pattern(command.send).match(data) is not None:
            return 0, 0
    found = parse_pattern(access.write.send).match(data)
    if found is None or parse_pattern(access.read.send).match(data) is not None:
        return None
    return int.from_bytes(found.get("index", b""), "little"), int.from_bytes(found.get("sub", b""), "little")


def _fits(found: Mapping[str, bytes], wanted: Mapping[str, bytes]) -> bool:
    """Whether an answer names the object and node that were asked for, as far as it names any."""
    return all(found[name] == wanted[name] for name in ("index", "sub", "node") if name in found)
