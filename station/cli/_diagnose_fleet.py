"""The work of `station diagnose --shared`: who in a fleet shares a cause."""

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from station.cli import _output
from station.cli._calibrate_fleet import check_document_place, write_document
from station.cli._fleet import FleetRequest, computed, describe_sources, recipes_in_use
from station.cli._log_options import parse_time_ns
from station.config.recipes import load_recipe, recipe_hash
from station.diagnosis.fleet.search import SharedFinding
from station.domain.records.stored_attempt import utc
from station.errors import LogError
from station.messages import Message, render
from station.ports.log_reader import Query
from station.service import fleet_diagnosis, time_text
from station.service.fleet import FleetJob
from station.service.fleet_diagnosis import FleetFindings, moments_portion
from station.wiring.fleet import code_version, openers


def diagnose_fleet(recipe_name: str, since: str | None, fleet: FleetRequest, json_path: Path | None) -> int:
    """Diagnoses and tells; 0 where no group stands out, 1 where one does.

    Errors: InputError, StoreFault, StationFault.
    """
    check_document_place(json_path)
    recipe = load_recipe(recipe_name)
    query = Query(recipe_name=recipe.name, since_ns=parse_time_ns(since, "--since"))
    used = {json.dumps(json.loads(text), sort_keys=True) for text in recipes_in_use(fleet.sources, query)}
    if len(used) > 1:
        raise LogError("fleet-mixed-recipes", count=len(used), recipe=recipe.name)
    with _output.activity(Message("activity-log", log=", ".join(map(str, fleet.sources)))):
        bank = fleet_diagnosis.learn_bank(recipe, query, openers(fleet.sources))
    job = FleetJob("diagnose", recipe, query, code_version(), given=bank.digest)
    with computed(fleet, job, partial(moments_portion, bank), fleet_diagnosis.COLUMNS) as (planned, results):
        found = fleet_diagnosis.search_fleet(bank, planned, results)
    document = {
        "schema": "station.fleet-diagnosis/1",
        "sources": describe_sources(fleet.sources),
        "recipe": {"name": recipe.name, "version": recipe.version, "hash": recipe_hash(recipe)},
        "attempts": planned.attempts,
        "compared": found.units,
        "dispersion": found.dispersion,
        "tested": sorted({cause.effect for cause in bank.causes}),
        "findings": [_document(finding) for finding in found.findings],
    }
    write_document(json_path, document)
    if str(json_path) != "-":
        _show(found)
    return 1 if found.findings else 0


def _document(f: SharedFinding) -> dict[str, Any]:
    group, cause = f.candidate.group, f.candidate.cause
    return {
        "effect": cause.effect,
        "level": f.candidate.level,
        "station": group.station or None,
        "nest": group.nest or None,
        "lot": group.lot or None,
        "position": cause.position or None,
        "size": f.size,
        "vector": list(f.vector),
        "std": list(f.std),
        "unit": cause.unit,
        "units": f.units,
        "begin": None if f.begin_ns is None else utc(f.begin_ns),
        "end": None if f.end_ns is None else utc(f.end_ns),
        "log_likelihood": f.nats,
        "indistinguishable_from": list(f.others),
    }


def _show(found: FleetFindings) -> None:
    if not found.findings:
        _output.print_message(Message("shared-none", units=found.units))
    for same in _by_cause(found.findings):
        first = same[0]
        std = max(first.std)
        unit, size = first.candidate.cause.unit, max(f.size for f in same)
        effect = first.candidate.cause.effect
        who = [_who(f) for f in same]
        _output.print_message(Message("shared-cause", effect=effect, size=size, unit=unit, std=std, who=who))
        if first.others:
            _output.print_line("  " + render(Message("shared-others", others=list(first.others))))


def _by_cause(findings: Sequence[SharedFinding]) -> list[list[SharedFinding]]:
    """Findings of one cause at one level of sharing together: those may have one origin."""
    groups: dict[tuple[str, str], list[SharedFinding]] = {}
    for finding in findings:
        groups.setdefault((finding.candidate.cause.effect, finding.candidate.level), []).append(finding)
    return list(groups.values())


def _who(f: SharedFinding) -> Message:
    at = f.candidate.group
    match f.candidate.level:
        case "nest":
            group = Message("shared-nest", nest=at.nest, station=at.station)
        case "lot":
            group = Message("shared-lot", lot=at.lot)
        case "position":
            group = Message("shared-position", position=f.candidate.cause.position, station=at.station)
        case _:
            group = Message("shared-station", station=at.station)
    since = "" if f.begin_ns is None else time_text.local_short(f.begin_ns)
    until = "" if f.end_ns is None else time_text.local_short(f.end_ns)
    if since and until:
        return Message("shared-between", group=group, since=since, until=until, units=f.units)
    if since:
        return Message("shared-since", group=group, since=since, units=f.units)
    if until:
        return Message("shared-until", group=group, until=until, units=f.units)
    return Message("shared-all", group=group, units=f.units)
