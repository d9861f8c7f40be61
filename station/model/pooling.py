"""One formula of several campaigns, such as those of several stations: what they agree on, and how far not.

Coefficients that all units share are pooled as results of laboratories are, by a random-effects mean whose variance
between campaigns is that of Paule & Mandel (1982), J. Res. NBS 87, 377, eq. 8; Cochran's Q says whether they agree.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.optimize
import scipy.special

from station.domain.core.types import Floats
from station.errors import InputError
from station.model.formula.term import Term
from station.model.formula.text import formula_text
from station.model.model_file import ModelEffect, SizedTerm

#: Chance at which campaigns that agree are told apart, all coefficients together.
LEVEL = 0.01
#: Time constants, frequencies and bends farther apart than this factor are those of two laws.
APART = 2.0
#: Temperatures that a formula is written about: another one moves a part of it into lower terms, no more.
MOVABLE = ("about_degC",)
#: Digits of a data hash that a source quotes.
DIGITS = 8


@dataclass(frozen=True, slots=True)
class FoundFormula:
    """What one model file says of the formula. name: for people, such as the file."""

    name: str
    found: ModelEffect


@dataclass(frozen=True, slots=True)
class PooledCoefficient:
    """One coefficient over all campaigns: mean and standard deviation, spread between campaigns, chance of such a Q."""

    axis: str
    value: float
    std: float
    between: float
    chance: float


@dataclass(frozen=True, slots=True)
class PooledFormula:
    """The formula that several campaigns hold. size: rms of its coefficients; sizes: smallest and largest met; dropped:
    of other families, which some campaigns could not tell from it and others could."""

    term: Term
    size: float
    sizes: tuple[float, float]
    source: str
    coefficients: tuple[PooledCoefficient, ...]
    dropped: tuple[Term, ...] = ()

    @property
    def agrees(self) -> bool:
        """Whether one value serves all campaigns."""
        return all(c.chance * len(self.coefficients) >= LEVEL for c in self.coefficients)


def pool(campaigns: Sequence[FoundFormula]) -> PooledFormula:
    """One formula of two or more campaigns: the one that all put first, or the simplest that is in the set of each.
    Where common coefficients disagree, each station gets its own.

    Errors: InputError where no formula is in every set, campaigns come from one and the same data, or lack standard
    deviations.
    """
    campaigns, dropped = _shared(campaigns)
    terms = [_term(c) for c in campaigns]
    _check_one_law(campaigns, terms)
    values = [_coefficients(c) for c in campaigns]
    term = _pooled_term(terms, values)
    pooled = tuple(_pooled(axis, values) for axis in term.axes) if term.of == "common" else ()
    sizes = [_rms_beyond_noise(v) for v in values]
    size = _rms_beyond_noise([row for v in values for row in v])
    made = PooledFormula(term, size, (min(sizes), max(sizes)), _source(campaigns), pooled, dropped)
    return made if made.agrees else replace(made, term=replace(term, of="station"))


@dataclass(frozen=True, slots=True)
class _Coefficient:
    axis: str | None
    value: float
    std: float


def _shared(campaigns: Sequence[FoundFormula]) -> tuple[Sequence[FoundFormula], tuple[Term, ...]]:
    """The campaigns with the formula that all hold in first place, and what not all of them hold."""
    sets = [{_law(f): f for f in reversed(_forms(c))} for c in campaigns]
    leaders = [_law(_forms(c)[0]) for c in campaigns]
    common = [law for law in sets[0] if all(law in forms for forms in sets)]
    if len(set(leaders)) == 1 or not common:
        return campaigns, ()
    chosen = min(common, key=lambda law: sets[0][law].term.term().description)
    dropped = {law[0]: forms[law].term.term() for forms in sets for law in forms if law not in common}
    chosen_first = [
        replace(c, found=c.found.model_copy(update=dict(forms[chosen])))
        for c, forms in zip(campaigns, sets, strict=True)
    ]
    return chosen_first, tuple(dropped.values())


def _forms(c: FoundFormula) -> list[SizedTerm]:
    """What a campaign's data hold alike, what it put first at the head."""
    assert c.found.term is not None
    return [SizedTerm(parameters=c.found.parameters, term=c.found.term), *c.found.equivalent]


def _law(form: SizedTerm) -> tuple[tuple[str, str], str, str]:
    """What makes formulas of two campaigns one: family, who shares it, unit."""
    return form.term.term().family, form.term.of, form.term.unit


def _term(c: FoundFormula) -> Term:
    assert c.found.term is not None
    return c.found.term.term()


def _check_one_law(campaigns: Sequence[FoundFormula], terms: Sequence[Term]) -> None:
    first, law = campaigns[0], terms[0]
    for c, term in zip(campaigns[1:], terms[1:], strict=True):
        unlike = term.family != law.family or term.of != law.of
        assert c.found.term is not None and first.found.term is not None
        if unlike or c.found.term.unit != first.found.term.unit:
            raise InputError(
                "pool-other-formula", file=c.name, other=first.name, formula=formula_text(term), law=formula_text(law)
            )
    for one, other in pairwise(sorted(campaigns, key=_data)):
        if _data(one) and _data(one) == _data(other):
            raise InputError("pool-same-data", file=other.name, other=one.name)
    for field, _ in law.constants:
        given = np.array([dict(t.constants)[field] for t in terms])
        if field not in MOVABLE and np.ptp(given) > (APART - 1) * np.abs(given).min():
            raise InputError("pool-constants-apart", field=field, low=float(given.min()), high=float(given.max()))


def _data(c: FoundFormula) -> str:
    """The hash of the data that a formula was found in; "" where its source does not say."""
    assert c.found.term is not None
    found = re.search(r"data ([0-9a-f]{4,64})", c.found.term.source)
    return found.group(1) if found else ""


def _coefficients(c: FoundFormula) -> list[_Coefficient]:
    rows = [p for p in c.found.parameters if p.name in ("coefficient", "angle") and not isinstance(p.value, str)]
    if not rows or any(p.std is None or not p.std > 0 for p in rows):
        raise InputError("pool-without-std", file=c.name)
    return [_Coefficient(p.axis, float(p.value), float(p.std or 0.0)) for p in rows]


def _pooled_term(terms: Sequence[Term], values: Sequence[Sequence[_Coefficient]]) -> Term:
    """The axes of all, each constant at its mean weighted by d²: its standard deviation goes as 1/d."""
    law = terms[0]
    weight = np.array([sum((v.value / v.std) ** 2 for v in own) for own in values])
    constants = tuple(
        (field, float(np.average([dict(t.constants)[field] for t in terms], weights=weight)))
        for field, _ in law.constants
    )
    return replace(law.with_axes({axis for t in terms for axis in t.axes}), constants=constants)


def _pooled(axis: str, values: Sequence[Sequence[_Coefficient]]) -> PooledCoefficient:
    rows = [row for own in values for row in own if row.axis in (axis, None)]
    y, std = np.array([r.value for r in rows]), np.array([r.std for r in rows])
    between = _between(y, std)
    weight = 1 / (std**2 + between)
    chance = float(scipy.special.chdtrc(len(y) - 1, _q(y, std, 0.0))) if len(y) > 1 else 1.0
    mean = float((weight * y).sum() / weight.sum())
    return PooledCoefficient(axis, mean, float(weight.sum() ** -0.5), float(between**0.5), chance)


def _between(y: Floats, std: Floats) -> float:
    """τ² with Q(τ²) = n − 1, or 0 where noise alone explains as much."""
    free = len(y) - 1
    if free < 1 or _q(y, std, 0.0) <= free:
        return 0.0
    scale = float(np.ptp(y))
    found = scipy.optimize.brentq(lambda t: _q(y / scale, std / scale, t) - free, 0.0, float(len(y)))
    return float(found) * scale**2


def _q(y: Floats, std: Floats, between: float) -> float:
    """Cochran's Q: Σ (y − mean)²/(std² + between)."""
    weight = 1 / (std**2 + between)
    return float((weight * (y - (weight * y).sum() / weight.sum()) ** 2).sum())


def _rms_beyond_noise(rows: Sequence[_Coefficient]) -> float:
    """Rms of the true coefficients: that of the values without their noise, at least a tenth of the former."""
    square = float(np.mean([r.value**2 for r in rows]))
    noise = float(np.mean([r.std**2 for r in rows]))
    return float(np.sqrt(max(square - noise, square / 100)))


def _source(campaigns: Sequence[FoundFormula]) -> str:
    """Such as "found in 3 campaigns, data 1f2e3d4c, 99aa0011, …"."""
    hashes = [data[:DIGITS] for c in campaigns if (data := _data(c))]
    shown = ", ".join(hashes[:3]) + (", ..." if len(hashes) > 3 else "")
    return f"found in {len(campaigns)} campaigns" + (f", data {shown}" if shown else "")
