"""The book of alerts: each alert of the watch once when it is raised, when its limit comes in sight, when it is over.

A book outlives its process: ids follow from the log, so that a watch that starts anew finds the same alerts and none is
sent twice. What ended before a book was begun is history, and nobody is told.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from station.domain.records.stored_attempt import utc
from station.domain.watch.size import drift_of
from station.messages import Message, render
from station.ports.store import Store
from station.service.watch import Finding

BOOK_SCHEMA, ALERT_SCHEMA = "station.alerts/1", "station.alert/1"
#: Events of the station in its log: what was raised, what ended, what comes.
EVENTS = {"raised": "watch-alert", "forecast": "watch-forecast", "ended": "watch-ended"}
AlertStage = Literal["raised", "forecast", "ended"]
#: Delivered alerts that the book still shows.
_RETAINED = 200
#: So many newest events of the log are compared with the book.
_COMPARED = 1000


@dataclass(frozen=True, slots=True, eq=False)
class ReportedFinding:
    """An alert as it now is. document: station.watch/1; text: its sentences."""

    document: Mapping[str, Any]
    text: Sequence[Message]


#: What is to be said of an alert.
Report = Callable[[Finding], ReportedFinding]


@dataclass(slots=True, eq=False)
class AlertBook:
    """issued: ids of every alert so far; entries: station.alert/1 with `pending`, the channels still to be reached;
    open: ids of what lasts."""

    issued: set[str] = field(default_factory=set)
    entries: list[dict[str, Any]] = field(default_factory=list)
    lasting: list[str] = field(default_factory=list)
    begun: bool = False

    @staticmethod
    def of(document: Mapping[str, Any]) -> "AlertBook":
        """Of a book that was kept. Errors: KeyError, TypeError, ValueError."""
        entries = [dict(entry) for entry in document["entries"]]
        return AlertBook(set(document["issued"]), entries, list(document["lasting"]), begun=True)

    def document(self) -> dict[str, Any]:
        """station.alerts/1."""
        return {
            "schema": BOOK_SCHEMA,
            "lasting": self.lasting,
            "entries": self.entries,
            "issued": sorted(self.issued),
        }

    def update(self, findings: Sequence[Finding], report: Report, channels: Sequence[str], at_ns: int) -> None:
        """Enters what is new, and asks for a report of nothing else; at_ns: now."""
        self.lasting = []
        for identity, finding in _identified(findings):
            over = finding.ended_ns is not None
            if not over:
                self.lasting.append(f"{identity}/raised")
            new = [stage for stage in _stages(finding) if f"{identity}/{stage}" not in self.issued]
            self.issued |= {f"{identity}/{stage}" for stage in new}
            if new and (self.begun or not over):
                one = report(finding)
                self.entries += [_entry(f"{identity}/{stage}", stage, one, channels, at_ns) for stage in new]
        self.begun = True
        done = [e for e in self.entries if not e["pending"] and e["id"] not in self.lasting]
        for entry in done[: max(0, len(self.entries) - _RETAINED)]:
            self.entries.remove(entry)

    def pending(self, channel: str) -> list[dict[str, Any]]:
        """What that channel has not got yet, oldest first."""
        return [entry for entry in self.entries if channel in entry["pending"]]

    def delivered(self, entry: dict[str, Any], channel: str) -> None:
        """The channel has it."""
        entry["pending"] = [name for name in entry["pending"] if name != channel]

    def standing(self) -> list[Message]:
        """The sentence of each alert that lasts."""
        raised = {entry["id"]: entry for entry in self.entries}
        return [Message.of(raised[id_]["message"]) for id_ in self.lasting if id_ in raised]


def record_alerts(store: Store, book: AlertBook) -> None:
    """Seals into the station's log what of the book is not there yet; the run does, as the log's one writer."""
    for stage, kind in EVENTS.items() if book.entries else ():
        known = {detail.get("id") for _, _, detail in store.station_events(kind, _COMPARED)}
        for entry in book.entries:
            if entry["what"] == stage and entry["id"] not in known:
                store.event("", kind, {name: entry[name] for name in ("id", "what", "at", "message", "alert")})


def _identified(findings: Sequence[Finding]) -> Iterator[tuple[str, Finding]]:
    """Each with what it is known by: station, recipe, the load that raised it, which one of those it was."""
    ordinal: Counter[str] = Counter()
    for found in findings:
        base = f"{found.station}/{found.recipe.name}/{found.recipe.version}/{found.alert.raised}"
        ordinal[base] += 1
        yield f"{base}/{ordinal[base]}", found


def _stages(finding: Finding) -> Iterator[AlertStage]:
    yield "raised"
    drift = drift_of(finding.alert, finding.recipe.limits)
    if finding.ended_ns is not None:
        yield "ended"
    elif drift is not None and drift.loads_to_limit is not None:
        yield "forecast"


def _entry(id_: str, stage: AlertStage, one: ReportedFinding, channels: Sequence[str], at_ns: int) -> dict[str, Any]:
    text = [render(message) for message in one.text]
    return {
        "schema": ALERT_SCHEMA,
        "id": id_,
        "what": stage,
        "at": utc(at_ns),
        "message": one.text[0].document(),
        "text": text,
        "alert": dict(one.document),
        "pending": list(channels),
    }
