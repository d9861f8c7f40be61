"""What `station diagnose` prints of a formula proposed for what no cause explains."""

from collections.abc import Iterator, Mapping
from typing import Any

from station.messages import Message, render
from station.reporting.diagnosis.quantity_format import unit_words

#: Coefficients printed of one formula; the document has all.
MOST_ROWS = 12
#: Formulas printed that fit as well.
MOST_EQUIVALENT = 4


def lines(findings: Mapping[str, Any]) -> Iterator[str]:
    """The lines; none where nothing was unknown."""
    found = findings["unknown"].get("hypotheses")
    if found is None:
        return
    if not found:
        yield "  " + render(Message("formula-none"))
    unit = findings["baseline"]["unit"]
    for h in found:
        yield "  " + render(Message("formula-proposed" if h["complete"] else "formula-partly", formula=h["formula"]))
        rows = h["parameters"]
        for p in rows[:MOST_ROWS]:
            yield parameter_line(p)
        if len(rows) > MOST_ROWS:
            yield "    " + render(Message("formula-more", count=len(rows) - MOST_ROWS))
        gain = h["gain"]
        before, after = f"{gain['rms_before']:.3g}", f"{gain['rms_after']:.3g}"
        score, std = f"{gain['log_score']:.3g}", f"{gain['std_error']:.2g}"
        said = "formula-gain" if gain["rms_after"] < gain["rms_before"] else "formula-gain-without-fall"
        yield "    " + render(
            Message(said, before=before, after=after, unit=unit, score=score, std=std, by=gain["held_out_by"])
        )
        others = h["equivalent"]
        for other in others[:MOST_EQUIVALENT]:
            yield "    " + render(Message("formula-equivalent", formula=other))
        if len(others) > MOST_EQUIVALENT:
            yield "    " + render(Message("formula-more", count=len(others) - MOST_EQUIVALENT))


def parameter_line(p: Mapping[str, Any]) -> str:
    """One coefficient with its standard uncertainty, none of a constant that a cause holds fixed; a dimensionless one
    without a unit."""
    unit = "" if p["unit"] == "1" else f" {unit_words(p['unit'])}"
    about = f" ± {p['std']:.2g}" if p["std"] else ""
    value = p["value"] if isinstance(p["value"], str) else f"{p['value']:.4g}{about}{unit}"
    return f"    {p['of']:<16} {p['axis'] or '':<4} {p['name']} {value}"
