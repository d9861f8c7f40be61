"""What can be wrong with a simulated device, as data: `Fault` values that it obeys."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from difflib import get_close_matches
from types import MappingProxyType

from station.errors import UsageError

#: kind → what the device does. `at` counts the SDO requests it is about, from 1; `after_s` counts from its start.
KINDS: Mapping[str, str] = MappingProxyType(
    {
        "silent": "does what is asked, but does not answer",
        "deaf": "does not hear SDO requests",
        "late": "answers `seconds` later than it should",
        "stale": "sends the answer to an earlier request once more before the right one",
        "wrong-object": "answers for another object (`value` is its index)",
        "refuse": "refuses with the abort code `code`; `access` (read, write) narrows it",
        "only-idle": "takes writes only while it is not operational; else it refuses them with 0x08000022",
        "wrong-toggle": "answers a segment with the wrong toggle bit",
        "lost-segment": "loses one segment of a block",
        "twice": "answers every request twice, as two devices with one node id do",
        "early": "sends, behind its answer, one to a request for the next sub-index that nobody has made yet",
        "other-id": "answers under the node id after its own",
        "holds": "an object holds `value` from power-on until it is written",
        "forgets": "an object is not among those that it saves",
        "remap": "its first PDO maps two objects in each other's place from `after_s` on",
        "not-operational": "stays pre-operational when it is started",
        "falls-back": "goes pre-operational by itself at `after_s`",
        "reads": "an object reads as `value`, whatever it holds",
        "reboot": "resets itself when SDO request `at` comes, before answering it",
        "power-cut": "loses power when SDO request `at` comes; power is back after `seconds` (0: never)",
        "save-fails": "refuses to save: hardware error 0x06060000",
        "save-lies": "confirms to save, but keeps nothing",
        "save-torn": "loses power half-way through the save: the first half of the objects is kept",
        "other-unit": "becomes another unit when SDO request `at` comes: the serial reads `value`",
        "no-boot-up": "does not send its boot-up message",
        "heartbeat-stops": "sends no heartbeat from `after_s` on",
        "heartbeat-slow": "sends a heartbeat only every `seconds`, whatever it says",
        "emergency": "sends EMCY `code`, with the error register `register`, at `after_s`, or, while operational,"
        " `seconds` after the last start; `times` of them, a millisecond apart",
        "spontaneous-reset": "resets itself at `after_s`",
        "counter-stuck": "the frame counter stands still",
        "status": "the status of its readings has the bits of `value` set as well",
        "crc-errors": "a `fraction` of the frames has a wrong CRC",
        "frames-lost": "a `fraction` of the frames is not sent",
        "frames-repeated": "a `fraction` of the frames is sent twice",
        "frames-swapped": "a `fraction` of the frames changes places with the next",
        "stream-stops": "sends no readings from `after_s` on",
        "stuck-axis": "axis number `value` (0 x, 1 y, 2 z) stands still",
        "thermometer-frozen": "the temperature stays as it was at `after_s`",
        "clock-fast": "its clock runs fast by the `fraction`",
        "babble": "floods the bus with frames of the highest priority from `after_s` on",
    }
)


@dataclass(frozen=True, slots=True)
class InjectedFault:
    """One fault. Text form: `kind` or `kind:index=0x2101,sub=1,code=0x06090030`.

    at, times: from which such request on, and how often (0: for ever, or once where that is the nature of the
    fault, as of a reboot); index, sub, access: only for this object, sub-index or direction; code, value,
    fraction, seconds, after_s, register: see KINDS.
    """

    kind: str
    at: int = 1
    times: int = 0
    index: int | None = None
    sub: int | None = None
    access: str | None = None
    code: int = 0x08000000
    value: float = 0.0
    fraction: float = 0.01
    seconds: float = 0.0
    after_s: float = 0.0
    register: int = 1

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            nearest = get_close_matches(self.kind[:40], KINDS, 1, 0.0)
            raise UsageError("device-fault-unknown", kind=self.kind[:40], nearest=nearest, known=tuple(KINDS))

    def meets(self, index: int, sub: int, access: str) -> bool:
        """Whether a request for this object in this direction (read, write) is one that the fault is about."""
        pairs = ((self.index, index), (self.sub, sub), (self.access, access))
        return all(wanted in (None, given) for wanted, given in pairs)


def parse(text: str) -> InjectedFault:
    """A fault from its text form; UsageError says what is wrong with it."""
    kind, _, rest = text.partition(":")
    known = {f.name: f.type for f in fields(InjectedFault) if f.name != "kind"}
    given: dict[str, int | float | str] = {}
    for part in filter(None, rest.split(",")):
        key, equals, value = part.partition("=")
        if key not in known or not equals:
            raise UsageError("device-fault-option", fault=text[:60], option=part[:40], known=tuple(known))
        given[key] = _value(text, key, value)
    return InjectedFault(kind, **given)  # type: ignore[arg-type]


def _value(text: str, key: str, value: str) -> int | float | str:
    if key == "access":
        if value not in ("read", "write"):
            raise UsageError("device-fault-access", fault=text[:60])
        return value
    try:
        if key == "value" and value.lower().startswith("0x"):
            return int(value, 16)
        return float(value) if key in ("value", "fraction", "seconds", "after_s") else int(value, 0)
    except ValueError:
        raise UsageError("device-fault-number", fault=text[:60], value=value[:40], key=key) from None
