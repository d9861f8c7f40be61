"""A proposed formula in the form of `unknown.hypotheses` in the document."""

from collections.abc import Iterator, Sequence
from itertools import count
from typing import Any

from station.diagnosis.discovery.price import price
from station.diagnosis.discovery.term_fit import TermFit
from station.diagnosis.results.estimate import Estimate
from station.diagnosis.results.hypotheses import Hypotheses, HypothesisTerm, rival_estimates
from station.diagnosis.results.parameter_rows import estimate_rows, gain_document
from station.model.effect import unit_in
from station.model.formula.model_term import ModelTerm
from station.model.formula.term import Term
from station.model.formula.text import formula_mathml, formula_text
from station.model.model_file import ModelEffect, SizedTerm, measured_parameter


def hypothesis_rows(h: Hypotheses, unit: str) -> list[dict[str, Any]]:
    """One formula, or none."""
    if not h.terms or h.gain is None:
        return []
    return [
        {
            "formula": formula_of(h),
            "complete": h.complete,
            "parameters": [row for t in h.terms for row in estimate_rows(t.estimate, unit)],
            "gain": gain_document(h.gain),
            "equivalent": equivalent_formulas(h),
            "terms": [_term_row(t, unit) for t in h.terms],
            "chance_nats": h.threshold,
            "data": h.data,
        }
    ]


def formula_of(h: Hypotheses) -> str:
    """All terms in a line."""
    return "; ".join(formula_text(t.found.fit.term) for t in h.terms)


def equivalent_formulas(h: Hypotheses) -> list[str]:
    """Formulas that these data cannot tell from the one given: each with one term in another form."""
    own = [formula_text(t.found.fit.term) for t in h.terms]
    return [
        "; ".join([*own[:i], formula_text(f.term), *own[i + 1 :]])
        for i, t in enumerate(h.terms)
        for f in t.found.equivalent
    ]


def term_document(term: Term, unit: str) -> dict[str, Any]:
    """A term as model files have it."""
    return {
        "input": term.input,
        "modulator": term.modulator,
        "axes": list(term.axes),
        "of": term.of,
        "constants": dict(term.constants),
        "unit": unit_in("rad" if term.is_turn else term.unit.text(), unit),
    }


def _term_row(t: HypothesisTerm, unit: str) -> dict[str, Any]:
    best = t.found.fit
    rivals = [f.odds for f in t.found.equivalent]
    return {
        "name": t.found.name,
        "formula": formula_text(best.term),
        "mathml": formula_mathml(best.term),
        **term_document(best.term, unit),
        "d": best.d,
        "score": t.found.score,
        "description_nats": price(best.term),
        "ahead_of_next_nats": best.odds - max(rivals) if rivals else None,
        "parameters": estimate_rows(t.estimate, unit),
        "gain": gain_document(t.gain),
        "equivalent": [_rival(f, best, unit) for f in t.found.equivalent],
    }


def _rival(f: TermFit, best: TermFit, unit: str) -> dict[str, Any]:
    """A formula that the data cannot separate from the best: how many nats it is behind, and the cosine of the two
    signals."""
    length = float(((f.signal**2).sum() * (best.signal**2).sum()) ** 0.5)
    cosine = float((f.signal * best.signal).sum()) / length if f.signal.shape == best.signal.shape and length else None
    return {
        "formula": formula_text(f.term),
        **term_document(f.term, unit),
        "behind_nats": best.odds - f.odds,
        "cosine": cosine,
    }


def model_effects(h: Hypotheses, unit: str, taken: Sequence[str]) -> Iterator[ModelEffect]:
    """The terms as a model file carries them."""
    names = (f"formula-{i}" for i in count(1))
    free = (name for name in names if name not in taken)
    for (i, t), name in zip(enumerate(h.terms), free, strict=False):
        own = _sized(t.found.fit, t.estimate, h.data, unit)
        rivals = tuple(_sized(fit, estimate, h.data, unit) for fit, estimate in rival_estimates(h, i))
        yield ModelEffect(effect=name, parameters=own.parameters, term=own.term, equivalent=rivals)


def _sized(fit: TermFit, estimate: Estimate, data: str, unit: str) -> SizedTerm:
    rows = [r for r in estimate_rows(estimate, unit) if r["name"] in ("coefficient", "angle")]
    source = f"found in data {data}, d {fit.d:.3g}; not yet explained"
    tree = {**term_document(fit.term, unit), "formula": formula_text(fit.term), "source": source}
    return SizedTerm(parameters=tuple(measured_parameter(r) for r in rows), term=ModelTerm.model_validate(tree))
