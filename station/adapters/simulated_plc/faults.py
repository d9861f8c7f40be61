"""What can be wrong with a simulated PLC, as data."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType

from station.errors import UsageError

#: kind → what happens. Those of the wire, then of the program, then of the cell.
KINDS: Mapping[str, str] = MappingProxyType(
    {
        "killed": "the PLC is gone: connections are refused",
        "silent": "takes requests and answers none",
        "late": "answers each request 1 s late",
        "slow": "answers each request 0.05 s late, which is allowed",
        "dropped": "closes the connection once in the middle of a request",
        "exception": "answers every request with Modbus exception 4",
        "garbage": "answers with bytes that are no Modbus",
        "restarted": "starts again: its working memory is empty, its starts count one more",
        "frozen": "its program stands: registers are answered as they were",
        "heartbeat-stale": "its heartbeat stands while the rest goes on",
        "other-protocol": "speaks version 2 of the protocol",
        "unknown-bits": "sets a status bit that the map does not name",
        "ignores-offer": "does not echo the number of a move",
        "stale-echo": "echoes the number with the target of the move before",
        "other-number": "echoes another number",
        "wrong-target": "echoes a target that differs in one number",
        "echo-changes": "changes its echo in the middle of a move",
        "refused": "refuses the move",
        "write-lost": "acknowledges a write and keeps nothing of it",
        "never-starts": "echoes, and does not start on the go",
        "go-delayed": "holds the words of the station back and executes them 2 s later",
        "stuck": "the drive starts and stands still",
        "crawls": "the drive turns at a thousandth of its speed",
        "done-early": "says done before it is there",
        "moves-unasked": "says that it moves when nobody asked it to",
        "door-open": "the door stands open",
        "door-opened": "somebody opens the door during the move",
        "clamp-open": "a clamp is not closed",
        "clamp-opened": "a clamp opens during the move",
        "safety-tripped": "the emergency stop is pressed during the move",
        "part-removed": "a part leaves its nest during the move",
        "load-repeated": "presents a load again that it has taken back",
        "load-forgotten": "loses its number of the load and counts from 1 again",
        "bins-differ": "echoes other bins than it was given",
        "taken-unasked": "takes a load back before it was given the bins",
    }
)
#: Those that begin with the offer of a move; the others with its motion, `after_s` later.
AT_OFFER = frozenset(
    {
        *("stale-echo", "other-number", "wrong-target", "refused", "never-starts", "go-delayed"),
        *("stuck", "crawls", "done-early"),
    }
)
#: Those that are there before the move is offered.
BEFORE_OFFER = frozenset({"ignores-offer", "door-open", "clamp-open", "write-lost", "moves-unasked"})
#: Those that begin with a load, when it is presented.
OF_LOADS = frozenset({"load-repeated", "load-forgotten", "bins-differ", "taken-unasked"})


@dataclass(frozen=True, slots=True)
class PlcFaultSpec:
    """One fault. Text form: `kind` or `kind:at=3,after_s=0.2,seconds=5`.

    at: in which move (or load) it begins, from 1; 0: from the start of the PLC on; after_s: seconds into the motion;
    seconds: how long it lasts, 0: for ever.
    """

    kind: str
    at: int = 1
    after_s: float = 0.2
    seconds: float = 0.0


def parse_fault(text: str) -> PlcFaultSpec:
    """The fault that a text describes. Errors: UsageError with the kinds or keys that there are."""
    kind, _, rest = text.partition(":")
    if kind not in KINDS:
        raise UsageError("plc-fault-unknown", kind=kind[:40], kinds=sorted(KINDS))
    known = {f.name: f.type for f in fields(PlcFaultSpec)[1:]}
    values: dict[str, float] = {}
    for part in filter(None, rest.split(",")):
        key, _, value = part.partition("=")
        try:
            values[key] = {"at": int, "after_s": float, "seconds": float}[key](value)
        except (KeyError, ValueError):
            raise UsageError("plc-fault-key", text=part[:40], keys=sorted(known)) from None
    return PlcFaultSpec(kind, int(values.pop("at", 1)), **values)
