"""An attempt in the WATS standard JSON format (WSJF): one step a limit that was decided."""

from collections.abc import Mapping
from typing import Any

_STATUS = {"PASS": "P", "FAIL": "F", "ERROR": "E", "ABORTED": "T", "INTERRUPTED": "T"}


def to_wsjf(facts: Mapping[str, Any]) -> dict[str, Any]:
    """The report document."""
    status = _STATUS.get(str(facts["outcome"]), "E")
    decided = [_step(i + 1, d) for i, d in enumerate(facts["decisions"])]
    performed, method = facts["performed"], facts["method"]
    return {
        "type": "T",
        "id": facts["log"]["attempt"],
        "pn": str(facts["item"]["identity"].get("name") or method["recipe"]),
        "sn": facts["item"]["serial"],
        "rev": str(facts["item"]["identity"].get("hardware") or ""),
        "processName": method["recipe"],
        "result": status,
        "machineName": performed["station"],
        "location": performed["nest"],
        "purpose": "SIMULATED" if facts["simulated"] else "",
        "startUTC": performed["began"],
        "uut": {"user": performed["operator"], "batchSN": facts["item"]["lot"]},
        "root": {"id": 0, "group": "M", "stepType": "SequenceCall", "name": method["recipe"], "status": status,
                 "seqCall": {"name": method["recipe"], "version": str(method["version"])}, "steps": decided},
    }  # fmt: skip


def _step(number: int, decision: Mapping[str, Any]) -> dict[str, Any]:
    room = decision["limit"] - decision["guard"]
    status = "P" if decision["margin"] >= 0 else "F"
    return {
        "id": number, "group": "M", "stepType": "ET_NLT", "name": decision["what"], "status": status,
        "numericMeas": [{"compOp": "GELE", "status": status, "unit": decision["unit"], "value": decision["value"],
                         "lowLimit": -room, "highLimit": room}],
    }  # fmt: skip
