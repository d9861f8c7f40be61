"""What the causes mean for the line: verdicts with and without them."""

from dataclasses import replace

from station.diagnosis.report.data import Verdicts
from station.domain import pipeline
from station.domain.recipe import Recipe
from station.domain.types import Floats, Outcome, SampleTable
from station.errors import StationError
from station.model.scene import scene_of_table


def verdicts(recipe: Recipe, table: SampleTable, effect: Floats, today: str) -> Verdicts | None:
    """Units that pass as they are, and with the effect (v, 3) of the causes on each stop taken off.

    None where the recipe has no limit that the readings could miss, or cannot calibrate them.
    """
    limits = recipe.limits
    if all(getattr(limits, k) is None for k in ("offset", "gain", "cross_axis", "residual", "consistency", "tilt_deg")):
        return None
    visit = scene_of_table(recipe, table).visit
    without = replace(table, reading=table.reading - effect[visit])
    try:
        before, after = (_passed(recipe, t, today) for t in (table, without))
    except StationError:
        # Data that can be diagnosed need not be such that the recipe's method can calibrate them: there is no verdict.
        return None
    return Verdicts(len(table.unit.names), before, after)


def _passed(recipe: Recipe, table: SampleTable, today: str) -> int:
    return sum(r.verdict.outcome is Outcome.PASS for r in pipeline.calibrate(recipe, table, today))
