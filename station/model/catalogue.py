"""Everything the effect files say of themselves, as rows and as the page docs/effects.md."""

from typing import Any

from station import plugins
from station.model.effect import Effect, Parameter
from station.model.model_file import EFFECTS

PAGE_HEAD = """# Causes that the simulation knows

This page is written by `station effects --markdown > docs/effects.md` from the effect files themselves; a test fails
when it is old. One cause is one file in `station/model/effects/`; its name is the cause's id.

* **Unit.** u stands for the recipe's unit. Typical sizes are given for a stimulus of 1 (1 g); for another stimulus they
  are scaled by the power of u in the unit.
* **Size.** A size is the rms of a cause's coefficients over its axes; `station simulate --effect ID=SIZE` sets it. A
  cause with one coefficient for all gets exactly that number, sign included.
* **Of.** Who shares one coefficient; the first is simulated, a diagnosis tries the others too.
* **Needs.** What must be known of the samples to see the cause: columns of the table, but for `since_arrival_s`, which
  follows from `time_s`, and `temperature_rate`, which follows from `temperature_degC`.
"""
LEVEL_TITLES = {"device": "The device", "rig": "The rig", "bus": "The bus"}


def rows() -> list[dict[str, Any]]:
    """One row for each cause, in the order of level and id."""
    kinds: list[type[Effect]] = list(plugins.load_all(EFFECTS).values())
    return [_row(kind) for level in LEVEL_TITLES for kind in kinds if kind.level == level]


def page() -> str:
    """The page, Markdown."""
    listed, parts = rows(), [PAGE_HEAD]
    for level, title in LEVEL_TITLES.items():
        parts.append(f"## {title}\n")
        parts.append("| id | physics | parameter | typical (range) | of | needs |\n|---|---|---|---|---|---|")
        parts.extend(_line(row) for row in listed if row["level"] == level)
        parts.append("")
    parts.append("## What to do, and what shows a cause\n")
    parts.append("| id | remedy | what shows it | drawn over | with unknown pose |\n|---|---|---|---|---|")
    for row in listed:
        known = "yes" if row["pose_free"] else "no"
        parts.append(_cells(f"`{row['effect']}`", row["remedy"], row["shown_by"], row["drawn_over"], known))
    parts.append("")
    parts.append("## Where the sizes come from\n")
    parts.append("| id | parameter | source |\n|---|---|---|")
    parts.extend(_cells(f"`{row['effect']}`", p["name"], p["source"]) for row in listed for p in row["parameters"])
    return "\n".join(parts) + "\n"


def _row(kind: type[Effect]) -> dict[str, Any]:
    effect = kind.example()
    return {
        "effect": kind.id,
        "physics": kind.physics,
        "level": kind.level,
        "of": list(kind.of),
        "axes": [axis for axis in kind.axes if axis],
        "needs": list(kind.needs),
        "quantities": list(kind.quantities),
        "remedy": kind.remedy,
        "shown_by": kind.shown_by,
        "drawn_over": kind.drawn_over,
        "pose_free": kind.pose_free,
        "parameters": [_parameter(effect, p) for p in (kind.parameter, *kind.forms)],
    }


def _parameter(effect: Effect, p: Parameter) -> dict[str, Any]:
    listed = (lambda value: value) if p in effect.forms else effect.value_of
    values = {key: listed(getattr(p, key)) for key in ("typical", "low", "high")}
    return {"name": p.name, "unit": p.unit, **values, "source": p.source}


def _line(row: dict[str, Any]) -> str:
    axes = f" ({', '.join(row['axes'])})" if row["axes"] else ""
    names = [f"{p['name']}{axes if i == 0 else ''}, {p['unit'] or 'text'}" for i, p in enumerate(row["parameters"])]
    sizes = [f"{_number(p['typical'])} ({_number(p['low'])} … {_number(p['high'])})" for p in row["parameters"]]
    cells = [f"`{row['effect']}`", row["physics"], "<br>".join(names), "<br>".join(sizes)]
    return _cells(*cells, ", ".join(row["of"]), ", ".join(row["needs"]))


def _cells(*texts: str) -> str:
    """A line of a table; a bar within a text, as of |a|, is none of the table's."""
    return "| " + " | ".join(text.replace("|", "\\|") for text in texts) + " |"


def _number(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"
