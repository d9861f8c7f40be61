"""PackML's counts, parameters, alarms and stop reasons as values of OPC UA, from what the line says."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from station.adapters.line_servers.asyncua_types import opc_ua
from station.adapters.line_servers.facts import LineFacts, StopFact
from station.domain.cell.adjustment import ADJUSTABLE
from station.domain.cell.handover import Bin
from station.domain.cell.packml import State

#: UNECE codes (OPC 10000-8, 5.6.3): one, second; and the catalogue that they are of.
_ONE, _SECOND = (17201, "1", "one"), (5457219, "s", "second")
_UNECE = "http://www.opcfoundation.org/UA/units/un/cefact"
#: The null of OPC UA's DateTime.
_NEVER = datetime(1601, 1, 1, tzinfo=UTC)
#: Bins whose units are not good: those that failed, and those that have no verdict of their own.
_DEFECTIVE = (Bin.REJECT, Bin.AGAIN)


def admin_values(facts: LineFacts) -> dict[str, Any]:
    """Values of the members of PackMLAdminObjectType, by name, as variants."""
    ua = opc_ua()
    seconds = [round(facts.seconds.get(state.label, 0.0)) for state in State]
    none = [0] * (len(State) + 1)
    lasting = [stop for stop in facts.stops if stop.ended_s is None]
    ended = [stop for stop in facts.stops if stop.ended_s is not None]
    stop = _alarm(facts.stops[0]) if facts.stops else _no_alarm()
    return {
        "AccTimeSinceReset": _int32(sum(seconds)),
        "StateCumulativeTime": _int32([none, [0, *seconds], none]),  # by mode and state, both from 0
        "ProdProcessedCount": _structures([_count(facts, 1, "units", tuple(Bin))]),
        "ProdDefectiveCount": _structures([_count(facts, int(b), b.name.lower(), (b,)) for b in _DEFECTIVE]),
        "Parameter": _structures(_parameters(facts)),
        "Alarm": _structures([_alarm(stop) for stop in lasting]),
        "AlarmExtent": _int32(1),
        "AlarmHistory": _structures([_alarm(stop) for stop in ended]),
        "AlarmHistoryExtent": _int32(len(ended)),
        "StopReason": ua.Variant(stop, ua.VariantType.ExtensionObject),
        "StopReasonExtent": _int32(1),
    }


def alarm_number(message_id: str) -> int:
    """A message's number: the same in every version, 31 bits of its id's CRC-32."""
    return zlib.crc32(message_id.encode()) & 0x7FFFFFFF


def _count(facts: LineFacts, number: int, name: str, bins: Sequence[Bin]) -> Any:
    made = opc_ua().PackMLCountDataType()
    counts = [facts.units.get(bin_.name.lower(), (0, 0)) for bin_ in bins]
    made.ID, made.Name, made.Unit = number, name, _unit(*_ONE)
    made.Count, made.AccCount = sum(c for c, _ in counts), sum(total for _, total in counts)
    return made


def _parameters(facts: LineFacts) -> list[Any]:
    found = []
    for number, known in ADJUSTABLE.items():
        made = opc_ua().PackMLDescriptorDataType()
        made.ID, made.Name, made.Unit = number, known.name, _unit(*_SECOND)
        made.Value = facts.times_s.get(known.name, 0.0)
        found.append(made)
    return found


def _alarm(stop: StopFact) -> Any:
    made = opc_ua().PackMLAlarmDataType()
    made.ID, made.Value, made.Message, made.Category = alarm_number(stop.id), 1, stop.text, stop.state
    made.DateTime = _time(stop.began_s)
    made.AckDateTime = _NEVER if stop.ended_s is None else _time(stop.ended_s)
    made.Trigger = stop.ended_s is None
    return made


def _no_alarm() -> Any:
    made = opc_ua().PackMLAlarmDataType()
    made.DateTime = made.AckDateTime = _NEVER
    return made


def _time(since_1970_s: float) -> datetime:
    return datetime.fromtimestamp(since_1970_s, UTC)


def _unit(code: int, text: str, description: str) -> Any:
    ua = opc_ua()
    return ua.EUInformation(_UNECE, code, ua.LocalizedText(text), ua.LocalizedText(description))


def _int32(value: Any) -> Any:
    ua = opc_ua()
    return ua.Variant(value, ua.VariantType.Int32)


def _structures(values: list[Any]) -> Any:
    ua = opc_ua()
    return ua.Variant(values, ua.VariantType.ExtensionObject, is_array=True)
