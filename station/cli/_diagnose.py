"""The work of `station diagnose`: read, diagnose, tell people and programs, write what is wanted."""

import hashlib
import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from station.cli import _hypotheses_text, _output
from station.cli._diagnosis_samples import MeasuredSource, without_gaps
from station.config.models import load_model
from station.config.recipes import load_recipe
from station.diagnosis.data import family, input_checks, preflight
from station.diagnosis.data.portions import reduce_portions
from station.diagnosis.data.preflight import Preflight
from station.diagnosis.data.seating_check import check_seatings
from station.diagnosis.planning.next_run import next_run
from station.diagnosis.planning.proposal import Proposal
from station.diagnosis.results import line_impact
from station.diagnosis.results.diagnose import Diagnosis, diagnose, diagnose_reduced
from station.diagnosis.results.diagnosis_document import document
from station.diagnosis.results.extend import extend_model
from station.diagnosis.search import alarm
from station.diagnosis.search.alarm import NullDistribution
from station.diagnosis.search.search_state import NullFactory
from station.domain.core.types import SampleTable
from station.domain.recipe.recipe import Recipe
from station.domain.records.stored_attempt import utc_day
from station.errors import UsageError, naming_file
from station.files.replace import replace_text
from station.messages import Message, render, system_reason
from station.model.model_file import Model
from station.wiring.process_memory import release_free_memory, retain_all_memory


@dataclass(frozen=True, slots=True)
class DiagnoseOutputs:
    """Files to write, or None; json may be - for standard output."""

    json: Path | None
    report: Path | None
    figures: Path | None
    extend: Path | None
    next_run: Path | None


def run_diagnose(
    samples: Path | None, db: Path | None, since: str | None, recipe_name: str, model: Path | None,
    wanted: DiagnoseOutputs, seed: int,
) -> int:  # fmt: skip
    """Diagnoses and tells; returns the exit code. Errors: InputError."""
    retain_all_memory()
    recipe = load_recipe(recipe_name)
    simulation = load_model(model, recipe.unit)
    for option, path in (("--report", wanted.report), ("--extend", wanted.extend), ("--next-run", wanted.next_run)):
        if path is not None and not path.parent.is_dir():
            raise UsageError("option-no-folder", option=option, path=str(path), folder=str(path.parent))
    with _output.activity(Message("activity-reading", file=str(samples or db))) as step:
        source = MeasuredSource(samples, db, since, recipe_name, recipe)
        with naming_file(samples or db):
            checked, found = _diagnosed(source, recipe, simulation, _cached_null(seed), step)
        step(Message("activity-planning"))
        proposed, proposal = next_run(found)
    today = utc_day(time.time_ns())
    findings = document(
        found, proposed, line_impact.document(line_impact.assess_line_impact(found, today), recipe.unit)
    )
    findings = {**findings, "preflight": checked.document(), "simulated": checked.simulated > 0}
    _write(wanted, findings, found, simulation)
    if wanted.next_run is not None:
        _write_next_run(wanted.next_run, proposal)
    if str(wanted.json) != "-":
        for line in preflight.lines(checked, recipe.unit):
            _output.print_message(line)
        _print_diagnosis(findings)
    return 0 if found.verdict == "none" else 1


def _diagnosed(
    source: MeasuredSource, recipe: Recipe, model: Model, null_of: NullFactory, step: Callable[[Message], None]
) -> tuple[Preflight, Diagnosis]:
    """What the preflight finds, and the diagnosis. A large table is gone through in portions, if nothing in it must be
    seen together."""
    portions = source.portions()
    reduced = None if portions is None else reduce_portions(recipe, portions)
    step(Message("activity-searching"))
    if reduced is not None:
        release_free_memory()
        inspected = reduced.inspection
        found = diagnose_reduced(reduced.recipe, inspected.samples, inspected, reduced.reduced, model, null_of)
        return reduced.preflight, found
    checked, table = _inspected(recipe, source.table())
    recipe = preflight.with_sheet(recipe, checked)
    input_checks.check_settles(recipe, table, utc_day(time.time_ns()))
    return checked, diagnose(recipe, table, model, null_of, checked.faults)


def _inspected(recipe: Recipe, table: SampleTable) -> tuple[Preflight, SampleTable]:
    """What the preflight finds, units far from the others included, and the samples that it leaves."""
    found, cleaned = preflight.inspect(recipe, table)
    cleaned = without_gaps(cleaned)
    preflight.check_orientations(recipe, found)
    check_seatings(recipe, cleaned)
    return replace(found, remarks=(*found.remarks, *family.of_table(recipe, cleaned))), cleaned


def _cached_null(seed: int) -> NullFactory:
    """Null distributions, drawn once for each kind of campaign and kept in the user's cache."""

    def null_of(problem: Any, fitted: Any, now: Any) -> NullDistribution:
        name = hashlib.sha256(alarm.cache_key(problem, fitted, now, seed).encode()).hexdigest()[:32]
        path = _cache_folder() / f"{name}.json"
        try:
            return NullDistribution.from_document(json.loads(path.read_text(encoding="utf-8")))
        except (OSError, ValueError, KeyError, TypeError):
            # Not there, or not whole: it is drawn anew.
            null = alarm.bootstrap(problem, fitted, now, seed)
        _store_null(path, null)
        return null

    return null_of


def _cache_folder() -> Path:
    from platformdirs import user_cache_path

    return user_cache_path("station") / "null"


def _store_null(path: Path, null: NullDistribution) -> None:
    """Keeps a null distribution; a cache that cannot be written only costs time."""
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_text(path, json.dumps(null.document()))


def _write(wanted: DiagnoseOutputs, findings: Mapping[str, Any], found: Diagnosis, model: Model) -> None:
    if str(wanted.json) == "-":
        _output.print_json(findings)
    elif wanted.json is not None:
        _write_text(wanted.json, "--json", json.dumps(findings, allow_nan=False, ensure_ascii=False))
    if wanted.report is not None or wanted.figures is not None:
        from station.cli._diagnosis_page import html, page_of_diagnosis, write_figures

        page = page_of_diagnosis(found, findings)
        if wanted.report is not None:
            _write_text(wanted.report, "--report", html(page, simulated=findings["simulated"]))
        if wanted.figures is not None:
            write_figures(wanted.figures, page)
    if wanted.extend is not None:
        import yaml

        lines = yaml.safe_dump(extend_model(model, found).document(), sort_keys=False, allow_unicode=True, width=120)
        _write_text(wanted.extend, "--extend", lines)


def _write_next_run(path: Path, proposal: Proposal | None) -> None:
    """Writes the recipe of the next run; nothing where no run would help."""
    if proposal is None:
        _output.print_remark(f"station: {render(Message('next-run-not-needed', path=str(path)))}")
        return
    import yaml

    recipe = proposal.recipe.model_copy(update={"version": proposal.recipe.version + 1})
    content = recipe.model_dump(mode="json", by_alias=True, exclude_defaults=True)
    text = yaml.safe_dump({"schema": "station.recipe/1", **content}, sort_keys=False, allow_unicode=True, width=120)
    _write_text(path, "--next-run", f"{_heading(recipe.name, proposal)}{text}")


def _heading(name: str, proposal: Proposal) -> str:
    """What the proposed recipe is for, as comments at its top."""
    lines = [
        f"{name} with {proposal.change}: {proposal.minutes:.1f} minutes more.",
        f"It separates {', '.join(proposal.separates)}; chance that a single cause is left: {proposal.certainty:.0%},",
        f"{_told_by(proposal)}. The runs measured before need not be measured again: diagnose",
        "their samples together with those of the new run, `run` counted on.",
    ]
    if proposal.next_nest:
        lines.append("Put each unit into the next nest for each new run.")
    if proposal.another_nest:
        lines.append("All was measured in one nest: put each unit into another one for the first new run.")
        lines.append("Where the rig has no other, no run tells apart what the nest does and what the rig does.")
    if proposal.recipe.turns_base:
        lines.append(
            "Turn the whole rig about the vertical for the run with `base_turn_deg`: a tilt of the floor then lies"
        )
        lines.append(
            "the other way. One that turns with the rig, as of unequal feet, counts as errors of its positions."
        )
    if any(run.temperature_swing_degC for run in proposal.recipe.runs):
        lines.append("Warm the units up to the middle of the run with `temperature_swing_degC`, by about so much, and")
        lines.append("let them cool to its end: the thermometer tells the course, which need not be exact.")
    if proposal.recipe.filters_off:
        lines.append(
            "Switch the devices' own low-pass filter off, or to its fastest, for the run with `filter: 'off'`:"
        )
        lines.append("its lag ends there, what swings in the rig stays. Leave it out where there is no such setting.")
    return "".join(f"# {line}\n" for line in lines)


def _told_by(proposal: Proposal) -> str:
    """What the chance comes from."""
    if proposal.chance is None:
        return "predicted from the size and the noise found"
    low, high = proposal.chance.interval
    return f"as in {proposal.chance.sets} simulated diagnoses (95 %: {low:.0%} to {high:.0%})"


def _write_text(path: Path, option: str, text: str) -> None:
    try:
        replace_text(path, text)
    except OSError as exc:
        raise UsageError("option-not-written", option=option, path=str(path), why=system_reason(exc)) from exc


def _line_sentences(findings: Mapping[str, Any]) -> Iterator[str]:
    """What the causes do to calibrations and verdicts."""
    found = findings["line"]
    if found is None:
        return
    worst = max(found["units"], key=lambda u: u["moves"])
    if not worst["moves"]:
        yield "on the line: calibrated readings do not move"
        return
    largest = f"{worst['moves']:.3g} {found['unit']} rms ({worst['serial']})"
    yield f"on the line: calibrated readings move by up to {largest}"
    if found["passed_before"] is not None:
        yield (
            f"  {found['verdicts_changed']} of {len(found['units'])} verdicts would change; "
            f"yield {found['yield_before']:.0%} as measured, {found['yield_after']:.0%} without what was found"
        )


def _print_diagnosis(findings: Mapping[str, Any]) -> None:
    """The finding for a person."""
    data, unit = findings["data"], findings["baseline"]["unit"]
    counts = render(Message("card-counts", units=data["units"], runs=data["runs"], visits=data["visits"]))
    _output.print_line(f"{counts}, {data['samples']} samples")
    _output.print_line(f"verdict: {findings['verdict']}. {findings['sentence']}")
    base = findings["baseline"]
    remaining = f", {findings['extended']['residual_rms']:.3g} {unit} with what was found" if findings["causes"] else ""
    # What is unknown is in the fitted floor too; the samples within the visits know nothing of it.
    within = findings["floor"]["within_stops"] if findings["verdict"] == "unknown" else 0.0
    floor = f"the noise floor alone makes {within or base['floor_rms']:.3g} {unit}"
    _output.print_line(f"residual {base['residual_rms']:.3g} {unit} rms{remaining}; {floor}")
    for cause in findings["causes"]:
        gain = cause["gain"]
        also = cause["indistinguishable_from"]
        names = cause["effect"] + (f" (or {', '.join(also)})" if also else "")
        _output.print_line(f"  {names}: probability {cause['probability']:.3f}; {_gain_text(gain, unit)}")
        for p in cause["parameters"][:12]:
            _output.print_line(_hypotheses_text.parameter_line(p))
        if len(cause["parameters"]) > 12:
            _output.print_line(f"    and {len(cause['parameters']) - 12} more; --json has all")
    for sentence in (*_hypotheses_text.lines(findings), *_line_sentences(findings)):
        _output.print_line(sentence)
    if findings["next_run"]:
        run = findings["next_run"]
        _output.print_line(
            f"next: {run['recipe_change']}, {run['minutes']} minutes, to separate {', '.join(run['separates'])}; "
            f"chance that a single cause is left: {run['certainty']:.0%}{_interval_text(run)}"
            if run["separates"]
            else f"next: {run['recipe_change'] or render(Message('next-none'))}"
        )
    if findings["not_testable"]:
        _output.print_line(f"not testable with these data: {', '.join(findings['not_testable'])}")


def _interval_text(run: Mapping[str, Any]) -> str:
    """The interval of a simulated chance."""
    if run["certainty_interval"] is None:
        return ""
    low, high = run["certainty_interval"]
    return f" ({low:.0%} to {high:.0%}, {run['simulated_diagnoses']} simulated diagnoses)"


def _gain_text(gain: dict[str, Any], unit: str) -> str:
    """What a cause gains on held-out data, in a few words."""
    if gain["log_score"] is None:
        return "too few visits to hold any out"
    score = f"{gain['log_score']:.3g} ± {gain['std_error']:.2g} nats" + (f" a {gain['per']}" if gain.get("per") else "")
    if gain["rms_before"] is None:
        return f"held out, {score}"
    return f"held-out residual {gain['rms_before']:.3g} → {gain['rms_after']:.3g} {unit}, {score}"
