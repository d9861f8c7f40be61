"""Lines out of what a reader sends."""

#: A reader that sends more without an end of line reads nothing sensible.
MOST_BYTES = 4096


class LineBuffer:
    """Bytes of one answer until its end of line."""

    def __init__(self) -> None:
        self._data = b""

    def take(self, data: bytes) -> str | None:
        """The line, once it is whole; control characters inside (GS, RS of a symbol) stay. None: not yet."""
        self._data = (self._data + data)[:MOST_BYTES]
        stripped = self._data.lstrip(b"\r\n\x02")
        for end in (b"\r", b"\n", b"\x03"):
            if end in stripped:
                return stripped.partition(end)[0].decode("utf-8", "replace")
        return None


def trigger_bytes(text: str, nest: str) -> bytes:
    """What is sent for a trigger; `\\r` and `\\n` of a YAML line are meant as such."""
    return text.replace("{nest}", nest).replace("\\r", "\r").replace("\\n", "\n").encode("utf-8")
