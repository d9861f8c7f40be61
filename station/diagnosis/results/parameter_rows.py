"""Sizes and gains as the documents write them."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from station.diagnosis.results.estimate import Estimate
from station.diagnosis.search.held_out_gain import HeldOutGain
from station.model.effect import Effect, unit_in


def gain_document(g: HeldOutGain) -> dict[str, Any]:
    return {
        "held_out_by": g.held_out_by,
        "rms_before": g.rms_before,
        "rms_after": g.rms_after,
        "explained": g.explained,
        "log_score": g.log_score,
        "std_error": g.std_error,
        "accepted": g.accepted,
    }


def estimate_rows(e: Estimate, unit: str) -> list[dict[str, Any]]:
    """Coefficients of the groups that act, then the parameters of the form."""
    candidate, effect = e.item.candidate, e.item.candidate.effect
    if effect is None:
        axes: tuple[str | None, ...] = ("x", "y", "z") if candidate.axes == 3 else (None,)
        return [
            {"name": "excess", "axis": axis, "of": candidate.names[g], "value": float(e.value[g, i]),
             "std": float(e.std[g, i]), "unit": unit}
            for g in np.flatnonzero(e.item.hit)
            for i, axis in enumerate(axes)
        ]  # fmt: skip
    rows: list[dict[str, Any]] = [
        {
            "name": column.name, "axis": column.axis or None, "of": candidate.names[g],
            "value": float(e.value[g, i]), "std": float(e.std[g, i]), "unit": unit_in(column.unit, unit),
        }
        for g in range(len(candidate.names)) if e.item.hit[g]
        for i, column in enumerate(effect.columns)
    ]  # fmt: skip
    estimated = {t.field: t for t in e.form}
    for effect, of in _forms_with_groups(e):
        for form in effect.form_parameters:
            std = estimated[form.field].std if form.field in estimated else e.form_std(form.field)
            value = float(getattr(effect, form.field))
            rows.append(
                {"name": form.name, "axis": None, "of": of, "value": value, "std": std, "unit": form.unit_in(unit)}
            )
    return rows


def _forms_with_groups(e: Estimate) -> Iterator[tuple[Effect, str]]:
    """The shapes of a cause, and whose they are: everybody's, or each group's own."""
    candidate = e.item.candidate
    if not candidate.own:
        yield from ((effect, "common") for effect in candidate.shapes)
    for effect, name, hit in zip(candidate.own, candidate.names, e.item.hit, strict=False):
        if hit:
            yield effect, name
