"""A cause in words, as its own file has them: what it is, what to do, and what would make it visible."""

from collections.abc import Collection
from dataclasses import dataclass

from station import plugins
from station.model.effect import DrawnOver, Effect
from station.model.model_file import EFFECTS

#: Covariates that follow from a column.
_SOURCE_COLUMNS = {"temperature_rate": "temperature_degC", "since_arrival_s": "time_s"}


@dataclass(frozen=True, slots=True)
class CauseText:
    """A cause in words: what it is, and what to do."""

    physics: str
    do: str


def cause_text(effect: str) -> CauseText:
    """A cause in words, by its id."""
    kind = _kind(effect)
    if kind is None:
        return CauseText(effect, "")
    return CauseText(kind.physics.rstrip("."), kind.remedy)


def makes_testable(effect: str, recorded: Collection[str]) -> str:
    """Which column or which change of the recipe would show a cause that was not testable."""
    kind = _kind(effect)
    missing = [name for name in (kind.needs if kind else ()) if name not in recorded and name != "gold"]
    if missing:
        columns = " and ".join(f"`{_SOURCE_COLUMNS.get(name, name)}`" for name in missing)
        return f"record {columns} in the samples"
    return kind.shown_by if kind else "measure more positions, runs or units"


def drawn_over(effect: str) -> DrawnOver | None:
    """What a cause is drawn against."""
    kind = _kind(effect)
    return kind.drawn_over if kind else None


def unit_of(effect: str, unit: str) -> str:
    """The unit of a cause's coefficient where readings are in `unit`."""
    kind = _kind(effect)
    return kind.parameter.unit_in(unit) if kind else ""


def _kind(effect: str) -> type[Effect] | None:
    return plugins.load(EFFECTS, effect) if effect in plugins.names(EFFECTS) else None
