"""The newest countersignature of a witness under the log's head, as certificates and exports carry it."""

import json
from typing import Any

from station.domain.records.tree_head import WITNESSED_EVENT
from station.ports.log_reader import LogReader


def newest_receipt(log: LogReader) -> dict[str, Any] | None:
    """The place, how many records it saw (size), their Merkle root, when (at_ns), and its signature; None without a
    witness. Errors: LogError."""
    events = log.station_events(WITNESSED_EVENT, 1)
    if not events:
        return None
    stored = json.loads(events[-1].detail)
    return {key: stored[key] for key in ("place", "size", "root", "at_ns", "signature")}
