"""What the log keeps of an attempt, as plain documents."""

from collections.abc import Sequence
from typing import Any

from station import __version__
from station.config.documents import canonical
from station.domain.capture.visit_check import STATION_CHECKS
from station.domain.core.types import NestAssignment, Outcome, Reason
from station.domain.records.stored_attempt import SIMULATED
from station.messages import Message, render
from station.ports.store import AttemptStart
from station.service.measure import RejectedUnits
from station.service.station import Job, Station
from station.service.unit import Unit


def attempt_start(seat: NestAssignment, station: Station, job: Job) -> AttemptStart:
    """The attempt's first record."""
    return AttemptStart(
        serial=seat.serial,
        station=station.settings.station,
        nest=seat.nest,
        node=seat.node,
        recipe_name=job.recipe.name,
        recipe_version=job.recipe.version,
        recipe_hash=job.recipe_hash,
        recipe_json=job.recipe_json,
        config_hash=station.config_hash,
        software=__version__ + (SIMULATED if station.simulated else ""),
        operator=station.settings.operator,
        started_ns=station.clock.epoch_ns(),
        lot=station.settings.lot,
        product_json=job.product_json,
        config_json=canonical(station.settings),
    )


def verdict_document(unit: Unit, outcome: Outcome) -> dict[str, Any]:
    """How the attempt ended, with every reason, the decision rule and its risks."""
    found = None if unit.fit is None else unit.fit.verdict
    return {
        "outcome": str(outcome),
        "reasons": _reasons(unit.reasons),
        "rule": render(found.rule) if found else None,
        "rule_message": found.rule.document() if found else None,
        "false_accept": found.false_accept if found else None,
        "false_reject": found.false_reject if found else None,
        "written": unit.written,
        "verified": unit.verified,
        "noise": unit.noise,
    }


def message_entry(message: Message) -> dict[str, Any]:
    """A message as the detail of an event: in English for people, with id and parameters for programs."""
    return {"sentence": render(message), "message": message.document()}


def _reasons(found: Sequence[Reason]) -> list[dict[str, Any]]:
    return [r.document() for r in found]


def rejection_outcome(bad: RejectedUnits, serial: str, alive: int) -> Outcome:
    """Whether a bad visit is the unit's (FAIL) or the station's (ERROR).

    A wrong face in one nest of several is that unit, seated wrongly or with its axes swapped; in all of them, or in
    the only one, nobody can tell it from a fixture that stands wrongly.
    """
    checks = {r.check for r in bad[serial]}
    if "rebooted" in checks:
        return Outcome.FAIL  # its silence afterwards is its own
    if "wrong-face" in checks and alive > 1 and len(bad) < alive:
        checks.discard("wrong-face")
    return Outcome.ERROR if checks & STATION_CHECKS else Outcome.FAIL
