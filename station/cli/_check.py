"""The work of `station check`: one function a section, each with a document for programs and lines for people."""

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from station.cli import _budget_table, _output
from station.cli._layout import TextTable
from station.config.recipes import load_recipe, recipe_hash, recipe_path
from station.config.settings import load_settings
from station.domain.core.types import Floats
from station.domain.evaluation.pipeline import NO_ROUNDING
from station.domain.line_quality.history import NOTHING, History
from station.domain.methods import coefficients, method, rank
from station.domain.planning import design, nominal_visits, optimal
from station.domain.planning.forecast import forecast
from station.domain.recipe import assumptions, references
from station.domain.recipe.recipe import Recipe
from station.domain.records.stored_attempt import utc_day
from station.errors import UsageError
from station.messages import Message, render
from station.wiring.jobs import load_job

if TYPE_CHECKING:
    from station.ports.log_reader import LogReader

SCHEMA = "station.check/1"


@dataclass(frozen=True, slots=True)
class CheckSection:
    """One part of the answer: key and value in the document; lines and tables for people."""

    key: str
    document: Any
    lines: tuple[str | TextTable, ...]


@dataclass(frozen=True, slots=True)
class RecipeCheckRequest:
    """See the command's options; design: so many positions are to be proposed."""

    recipe: str
    design: int | None = None
    config: Path | None = None
    db: Path | None = None
    order: bool = False


@dataclass(frozen=True, slots=True)
class CheckSubject:
    """What is checked: a recipe that stands, with what the log knows of its process and reproducibility, its file, and
    how its product rounds coefficients (12)."""

    recipe: Recipe
    path: Path
    rounding: Floats
    request: RecipeCheckRequest
    history: History


def check_recipe(request: RecipeCheckRequest, *, as_json: bool) -> int:
    """Checks and prints; 0 when the recipe is sound. Errors: InputError, ReferenceOverdue."""
    name, count = request.recipe, request.design
    if count is not None and request.order:
        raise UsageError("check-design-or-order")
    recipe = load_recipe(name)
    if recipe.product is not None:
        load_job(name)  # refuses a map, EDS and DBC that contradict each other
    references.check_due(recipe, utc_day(time.time_ns()))
    found = _learnt(recipe, request)
    subject = CheckSubject(
        found.applied(recipe), recipe_path(name), _rounding(recipe, recipe_path(name)), request, found
    )
    if count is None:
        design.check(recipe)
    chosen = SECTIONS if count is None else (_proposal(count),)
    if request.order:
        chosen = (partial(_order, request.config),)
    with _output.activity(Message("activity-separating", recipe=recipe.name)):
        sections = [s for s in (make(subject) for make in chosen) if s is not None]
    if as_json:
        head = {"schema": SCHEMA, "recipe": {"name": recipe.name, "version": recipe.version}}
        _output.print_json(head | {s.key: s.document for s in sections})
        return 0
    for section in sections:
        for line in section.lines:
            if isinstance(line, TextTable):
                _output.print_table("", line)
            else:
                _output.print_line(line)
    return 0


def _own_log(request: RecipeCheckRequest) -> "tuple[Path, LogReader | None]":
    """The log that is named, or the station's own where there is one."""
    path = request.db or Path(load_settings(request.config).database)
    if request.db is None and not path.exists():
        return path, None
    from station.wiring.logs import open_log

    return path, open_log(path)


def _learnt(recipe: Recipe, request: RecipeCheckRequest) -> History:
    """What the next run will have learnt from the log."""
    from station.config.products import load_product
    from station.service import history

    _, log = _own_log(request)
    if log is None:
        return NOTHING
    with log:
        device = None if recipe.product is None else load_product(recipe.product, recipe_path(request.recipe)).map
        return history.learnt(log, recipe_hash(recipe), device, load_settings(request.config))


def _rounding(recipe: Recipe, path: Path) -> Floats:
    from station.config.products import load_product
    from station.domain.product import writeback

    return NO_ROUNDING if recipe.product is None else writeback.rounding_std(load_product(recipe.product, path).map)


def _summary(subject: CheckSubject) -> CheckSection:
    r = subject.recipe
    visits = sum(len(r.positions) for _ in r.runs)
    sentence = f"{r.name} version {r.version}: {r.sensor}, {r.method}, {len(r.positions)} positions, {visits} visits"
    return CheckSection("method", r.method, (sentence,))


def _cycle_time(subject: CheckSubject) -> CheckSection:
    """By the station's own log where it has one."""
    from station.service.cycle_time import forecast_cycle

    path, log = _own_log(subject.request)
    with nullcontext() if log is None else log:
        units = len(load_settings(subject.request.config).nests)
        found = forecast_cycle(subject.recipe, log, units)
    source = "cycle-time-same" if found.same else "cycle-time-others" if found.attempts else "cycle-time-usual"
    load = {"cycle_s": found.cycle_s, "units": units, "one_s": found.one_s}
    message = Message(source, **load, attempts=found.attempts, log=str(path))
    return CheckSection("cycle_s", found.cycle_s, (render(message),))


def _history(subject: CheckSubject) -> CheckSection:
    """Process and reproducibility as the log's own results show them."""
    found = subject.history
    return CheckSection("history", found.document(), tuple(render(m) for m in found.messages(subject.recipe)))


def _observability(subject: CheckSubject) -> CheckSection | None:
    recipe = subject.recipe
    if not recipe.pose_known:
        return None
    rows, names = design.rows_of(recipe)
    found = {
        "rank": rank.of(rows),
        "coefficients": rows.shape[1],
        "condition": rank.condition(rows),
        "d_efficiency": design.efficiency(recipe),
        "next_position": design.next_position(recipe) if method.of(recipe).open_ended else None,
    }
    lines: tuple[str, ...] = (
        f"rank {found['rank']} of {found['coefficients']} ({', '.join(dict.fromkeys(names))})",
        f"condition {found['condition']:.3g}; D-efficiency {found['d_efficiency']:.1%} of the best design of that size",
    )
    if found["next_position"]:
        lines = (*lines, f"next best position: {found['next_position']}")
    return CheckSection("design", found, lines)


def _range(subject: CheckSubject) -> CheckSection | None:
    """The positions that ask more of the device than its sheet allows; nothing where there are none."""
    recipe = subject.recipe
    beyond = nominal_visits.beyond_range(recipe)
    if not beyond:
        return None
    full = {"positions": beyond, "full_scale": recipe.device.full_scale, "unit": recipe.unit}
    return CheckSection("beyond_range", beyond, (render(Message("positions-beyond-range", **full)),))


def _uncertainty(subject: CheckSubject) -> CheckSection | None:
    recipe = subject.recipe
    if not recipe.pose_known:
        sentence = "hand-held visits: the uncertainty depends on where they will be, so it is stated with the result"
        return CheckSection("predicted", None, (sentence,))
    found = forecast(recipe, subject.rounding)
    std = found.budget.std()
    predicted = [
        {"coefficient": n, "std": float(s), "expanded": float(wide), "unit": coefficients.unit_of(i, recipe.unit)}
        for i, (n, s, wide) in enumerate(zip(coefficients.NAMES, std, found.budget.expanded(), strict=True))
    ]
    noise = f"noise of one sample {found.noise:.2g} {recipe.unit}"
    if recipe.device.noise_density is None:
        noise += ", assumed: device.noise_density is not given"
    title = f"predicted standard deviations ({noise})"
    document = {
        "noise": found.noise,
        "dwell_s": found.dwell_s.tolist(),
        "coefficients": predicted,
        "decisions": [_decision(d) for d in found.decisions],
    }
    words = tuple(_decision_sentence(d, recipe.unit) for d in found.decisions) or ("limits: none in the recipe",)
    return CheckSection(
        "predicted",
        document,
        (_dwell_sentence(found), title, *_budget_table.budget_tables(found.budget, recipe.unit), *words),
    )


#: What to do about an assumption where stating it is not the way.
_REMEDIES = {
    assumptions.HIDDEN_SCATTER: "add a run or positions, or state reproducibility",
    "device.rounding": "state nearest or truncating",
    "reference.site.heading_deg": "state reference.site with heading_deg",
}


def _assumptions(subject: CheckSubject) -> CheckSection:
    """Every contribution to the uncertainty as stated or as assumed; a warning where the recipe leaves it open."""
    found = assumptions.listing(subject.recipe)
    document = [
        {"key": a.key, "std": a.value, "unit": a.unit, "stated": a.stated, "source": render(a.source)} for a in found
    ]
    lines = tuple(
        f"assumed: {a.key} = {a.value:.2g}{'' if a.unit == '1' else ' ' + a.unit} ({render(a.source)}); "
        f"{_REMEDIES.get(a.key, 'state a value, even if it is 0')}"
        for a in found
        if not a.stated
    )
    return CheckSection("assumptions", document, lines)


def _dwell_sentence(found: Any) -> str:
    """How long the visits last by the sheet's noise, and whether that is enough."""
    least, most = float(found.dwell_s.min()), float(found.dwell_s.max())
    each = f"{least:.2g} s a visit" if most - least < 0.005 else f"{least:.2g} to {most:.2g} s a visit"
    sentence = f"dwell: {each}, {found.dwell_s.sum():.3g} s in all"
    return f"{sentence}. {render(found.missed)}" if found.missed else sentence


def _decision(d: Any) -> dict[str, Any]:
    return {k: getattr(d, k) for k in ("kind", "coefficient", "limit", "expanded", "guard", "verdict", "risks")}


def _decision_sentence(d: Any, unit: str) -> str:
    of = f" {unit}" if d.kind in ("offset", "verification") else ""
    ratio = d.limit / d.expanded if d.expanded > 0 else np.inf
    words = {
        "comfortable": "can be decided with ease",
        "tight": "can be decided, but many good units near it will fail or some bad ones pass",
        "impossible": "cannot be decided by this recipe: dwell longer, add positions, or widen the limit",
    }
    if d.kind == "verification":
        words["impossible"] = (
            "cannot be decided: no unit passes; widen verify.limit, or know nest, base and reference better"
        )
    risks = "" if d.risks is None else f"; {render(Message('global-risks', consumer=d.risks[0], producer=d.risks[1]))}"
    name, wide = d.kind.replace("_", "-"), f"{d.expanded:.2g} (1 : {ratio:.2g})"
    return f"limit {name} {d.limit:g}{of}: U = {wide}; {words[d.verdict]}{risks}"


def _proposal(count: int) -> Callable[[CheckSubject], CheckSection]:
    def propose(subject: CheckSubject) -> CheckSection:
        recipe = subject.recipe
        true = optimal.search(recipe, count)
        positions = [optimal.as_yaml(f"p{i + 1:02d}", t, recipe) for i, t in enumerate(true)]
        lines = ("positions:", *(f"  - {p}" for p in positions))
        return CheckSection(
            "positions", [{"yaml": p, "true": t.tolist()} for p, t in zip(positions, true, strict=True)], lines
        )

    return propose


def _order(config: Path | None, subject: CheckSubject) -> CheckSection:
    from station.cli._check_order import order_proposal

    if not subject.recipe.pose_known:
        raise UsageError("check-order-by-hand", recipe=subject.recipe.name)
    return CheckSection("order", *order_proposal(subject.recipe, config))


def _causes(subject: CheckSubject) -> CheckSection | None:
    """Which causes of trouble the recipe shows and tells apart; nothing where nobody knows the pose."""
    if not subject.recipe.pose_known:
        return None
    from station.cli._check_causes import distinguishable_causes

    return CheckSection("causes", *distinguishable_causes(subject.recipe))


#: What a check tells, in order. A section returns None where it does not apply.
SECTIONS: tuple[Callable[[CheckSubject], CheckSection | None], ...] = (
    _summary,
    _cycle_time,
    _observability,
    _range,
    _uncertainty,
    _assumptions,
    _history,
    _causes,
)
