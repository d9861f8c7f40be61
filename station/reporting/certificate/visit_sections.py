"""What was measured at each visit: the stimulus, the mean reading, and what the fit leaves of it."""

from collections.abc import Mapping, Sequence
from typing import Any

from station.domain.methods.coefficients import AXES
from station.domain.recipe.recipe import Recipe
from station.reporting.certificate.writer import CertificateTable, SectionWriter
from station.reporting.number_text import format_number, format_to_uncertainty, quantity_in

_TILT = ("tilt_deg", "tilt_std_deg")
#: Of a stimulus more digits are those of cosines, not of anything known.
_STIMULUS_DIGITS = 6


def reading_table(w: SectionWriter, content: Mapping[str, Any], recipe: Recipe) -> CertificateTable:
    """Stimulus, as far as the recipe knows it, and mean reading at each visit."""
    axes, visits = AXES[: recipe.axes], content["visits"]
    kinds = ("stimulus", "reading") if visits and visits[0]["stimulus"] is not None else ("reading",)
    heads = (w("position"), *(quantity_in(w(kind, axis), recipe.unit) for kind in kinds for axis in axes))
    rows = []
    for visit in visits:
        shown = [format_number(round(value, 9) + 0.0, _STIMULUS_DIGITS) for value in visit["stimulus"] or ()]
        means = zip(visit["mean"], visit["std_of_mean"], strict=True)
        rows.append((_name(w, visit, visits), *shown, *(format_to_uncertainty(mean, std) for mean, std in means)))
    return w.section("cert_readings", heads, tuple(rows))


def residual_table(w: SectionWriter, fit: Mapping[str, Any], recipe: Recipe) -> CertificateTable:
    """Tilt and residual at each visit. No stimulus shows no tilt."""
    heads = (
        *(w("position"), w("tilt"), w("tilt_u")),
        *(quantity_in(w("residual", axis), recipe.unit) for axis in AXES[: recipe.axes]),
    )
    rows = tuple(
        (
            _name(w, p, fit["positions"]),
            *(format_to_uncertainty(p[key] if p["tilt_std_deg"] else None, p["tilt_std_deg"]) for key in _TILT),
            *_rounded(p["residual"][: recipe.axes], fit["residual_rms"]),
        )
        for p in fit["positions"]
    )
    return w.section("cert_stops", heads, rows)


def _rounded(values: Sequence[float], spread: float) -> list[str]:
    return [format_to_uncertainty(value, spread) for value in values]


def _name(w: SectionWriter, visit: Mapping[str, Any], visits: Sequence[Mapping[str, Any]]) -> str:
    """Position, with the seating that is not the usual one, the run where there are several, and that the fit leaves
    it out."""
    seating, several = str(visit.get("seating", "home")), len({v.get("run") for v in visits}) > 1
    more = [] if seating == "home" else [seating]
    more += [w("run", str(visit["run"] + 1))] if several else []
    more += [w("left_out")] if visit.get("disturbed") else []
    return f"{visit['name']} ({', '.join(more)})" if more else str(visit["name"])
