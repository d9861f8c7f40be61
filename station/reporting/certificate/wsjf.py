"""An attempt in the WATS standard JSON format (WSJF): one step a limit that was decided."""

from collections.abc import Mapping
from typing import Any

from station.domain.records import stored_attempt

_STATUS = {"PASS": "P", "FAIL": "F", "ERROR": "E", "ABORTED": "T", "INTERRUPTED": "T"}


def to_wsjf(stored: Mapping[str, Any]) -> dict[str, Any]:
    """The report document of a stored attempt that has ended, however it did."""
    found = [stored_attempt.result(stored, name) or {} for name in ("calibration", "verification")]
    decided = [decision for one in found for decision in one.get("decisions") or ()]
    identity = stored_attempt.result(stored, "identity") or {}
    reasons = (stored_attempt.result(stored, "verdict") or {}).get("reasons", ())
    status, recipe = _STATUS.get(str(stored["outcome"]), "E"), stored["recipe_name"]
    report: dict[str, Any] = {
        "type": "T",
        "id": stored["attempt"],
        "pn": str(identity.get("name") or recipe),
        "sn": stored["serial"],
        "rev": str(identity.get("hardware") or ""),
        "processName": recipe,
        "result": status,
        "machineName": stored["station"],
        "location": stored["nest"],
        "purpose": stored_attempt.mark_of(stored["software"]),
        "startUTC": stored["started"],
        "uut": {"user": stored["operator"], "batchSN": stored["lot"]},
        "root": {"id": 0, "group": "M", "stepType": "SequenceCall", "name": recipe, "status": status,
                 "seqCall": {"name": recipe, "version": str(stored["recipe_version"])},
                 "steps": [_step(i + 1, d) for i, d in enumerate(decided)]},
    }  # fmt: skip
    if reasons:
        report["miscInfos"] = [{"description": "reason", "text": reason["sentence"]} for reason in reasons]
    return report


def _step(number: int, decision: Mapping[str, Any]) -> dict[str, Any]:
    room = decision["limit"] - decision["guard"]
    status = "P" if decision["margin"] >= 0 else "F"
    return {
        "id": number, "group": "M", "stepType": "ET_NLT", "name": decision["what"], "status": status,
        "numericMeas": [{"compOp": "GELE", "status": status, "unit": decision["unit"], "value": decision["value"],
                         "lowLimit": -room, "highLimit": room}],
    }  # fmt: skip
