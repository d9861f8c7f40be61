"""`station check --order`: the positions of every run in the order of least moving time, to paste into the recipe."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from station.domain.core.types import Floats
from station.domain.recipe import moves, ordering, plan
from station.domain.recipe.ordering import MoveTimes
from station.domain.recipe.plan import PlannedVisit
from station.domain.recipe.position import Position
from station.domain.recipe.recipe import Recipe
from station.ports.positioner import Positioner

#: Where the moving times come from, in words.
DEFAULT_SPEEDS = (
    "at the speeds of an ordinary bench (90 deg/s, 180 deg/s2); give --config FILE for your positioner's own"
)


def order_proposal(recipe: Recipe, config: Path | None) -> tuple[Any, tuple[str, ...]]:
    """Document and lines. Errors: InputError of config.yaml."""
    positioner = None if config is None else _positioner(config)
    found = [_run_proposal(recipe, run, positioner) for run in range(len(recipe.runs))]
    source = DEFAULT_SPEEDS if config is None else f"by the positioner of {config}"
    lines = [f"moving times {source}"]
    for each in found:
        lines += [_order_sentence(each), "positions:", *(f"  - {text}" for text in each["yaml"])]
    return {"moving_times": source, "runs": found}, tuple(lines)


def _run_proposal(recipe: Recipe, run: int, positioner: Positioner | None) -> dict[str, Any]:
    start, end = plan.ends(recipe, run)
    positions = recipe.positions
    free = (
        moves.bench_move_times(positions, start, end)
        if positioner is None
        else _estimated_moves(positioner, positions, start, end)
    )
    best = ordering.fastest(moves.allowed_moves(free, positions, recipe.runs[run]))
    names = [p.name for p in positions]
    now = np.array([names.index(p.name) for p in plan.order_of(recipe, run)])
    return {
        "run": run,
        "order": recipe.runs[run].order,
        "moves_s": free.of(now),
        "fastest_s": free.of(best),
        "exact": len(best) <= ordering.MAX_EXACT,
        "positions": [names[i] for i in best],
        "yaml": [_yaml(positions[i]) for i in best],
    }


def _order_sentence(found: dict[str, Any]) -> str:
    what = "the fastest order" if found["exact"] else "the fastest order found"
    now = f"run {found['run']} ({found['order']}): moves take {found['moves_s']:.1f} s"
    return f"{now}, {found['fastest_s']:.1f} s in {what}"


def _positioner(config: Path) -> Positioner:
    """The positioner of config.yaml; nothing is moved with it."""
    from station.config.settings import load_config
    from station.wiring.positioners import unused_positioner

    settings, document = load_config(config)
    return unused_positioner(settings, document)


def _estimated_moves(
    positioner: Positioner, positions: tuple[Position, ...], start: Floats, end: Floats | None
) -> MoveTimes:
    """Moves as the positioner itself estimates them."""
    visits = [_planned_visit(p.name, p.matrix()) for p in positions]
    begin, after = _planned_visit("start", start), None if end is None else _planned_visit("end", end)
    return MoveTimes(
        np.array([[positioner.estimate_s(a, b) for b in visits] for a in visits]),
        np.array([positioner.estimate_s(begin, visit) for visit in visits]),
        np.array([0.0 if after is None else positioner.estimate_s(visit, after) for visit in visits]),
    )


def _planned_visit(name: str, nest: Floats) -> PlannedVisit:
    return PlannedVisit(0, 0, name, "home", nest, np.eye(3), np.full(3, np.nan), None)


def _yaml(position: Position) -> str:
    """A position as a recipe says it, on one line."""
    entry = position.model_dump(mode="json", exclude_none=True)
    return str(yaml.safe_dump(entry, default_flow_style=True, sort_keys=False, width=1 << 30)).strip()
