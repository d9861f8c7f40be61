"""How certain names may be together: beside stronger ones that are not certain, and over a rest that hardly any chance
leaves, or that follows what they follow.

What a wrong form leaves is as large as a weaker cause, and may look like one; or it looks like nothing, and stays below
what alarms. A rest as rare as p speaks for something more by at most 1 / (−e p ln p) (Sellke, Bayarri and Berger, Am.
Stat. 55 (2001) 62). Where the rest follows something that nobody has described, a cause that acts by the same may be
the nearest part of one law of both, and so may a scatter, which holds a part of anything: neither is surer than where a
law would do the same.
"""

from collections.abc import Sequence, Set

import numpy as np

from station.diagnosis.candidates.kernels import acts_by
from station.diagnosis.search.alarm import chance_of
from station.diagnosis.search.finding import UNLIKELY, CauseFinding
from station.diagnosis.search.form_check import PRIOR_NATS

#: The chance of a cause where a law that nobody wrote would do the same.
LAW_WOULD_DO = float(1 / (1 + np.exp(-PRIOR_NATS)))
#: Rests at least as usual as this speak for nothing more.
USUAL = float(np.exp(-1))


def as_certain_together(
    findings: Sequence[CauseFinding], statistic: float, threshold: float
) -> tuple[CauseFinding, ...]:
    """The findings, none so certain that what is beside it or left speaks against. statistic: of the rest, which alarms
    from a threshold on."""
    left = {word for f in findings for word in f.words}
    doubted = [_beside_unknown(f, left) if left and not f.is_unlikely else f for f in findings]
    doubted = [_over_rest(f, statistic, threshold) if _is_likely(f) else f for f in doubted]
    return tuple(_beside_stronger(f, doubted) if _is_likely(f) else f for f in doubted)


def _beside_unknown(f: CauseFinding, left: Set[str]) -> CauseFinding:
    """A finding beside a rest that follows some covariates and that nobody has described."""
    effect = None if f.accepted is None else f.accepted.candidate.effect
    apart = effect is not None and acts_by(effect) not in left
    return f if apart or f.words else f.at_most(LAW_WOULD_DO)


def _is_likely(f: CauseFinding) -> bool:
    return f.accepted is not None and not f.is_unlikely


def _over_rest(f: CauseFinding, statistic: float, threshold: float) -> CauseFinding:
    """A finding over a rest that does not alarm, by how rare that is; likelier than not still, as nothing is shown."""
    chance = chance_of(statistic, threshold)
    if statistic > threshold or chance >= USUAL:
        return f
    odds = np.exp(-PRIOR_NATS) * (-1 / (np.e * chance * np.log(chance)) - 1)
    return f.at_most(max(f.set_probability / (1 + odds), UNLIKELY))


def _beside_stronger(f: CauseFinding, findings: Sequence[CauseFinding]) -> CauseFinding:
    """A finding, no more certain than any stronger one, and no more likely than not beside an unlikely one."""
    stronger = [one.set_probability for one in findings if one.accepted is not None and one.d > f.d]
    return f.at_most(max(min(stronger, default=1.0), UNLIKELY))
