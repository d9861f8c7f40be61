"""How certain names may be together: beside stronger ones that are not certain, and over a rest that hardly any chance
leaves.

What a wrong form leaves is as large as a weaker cause, and may look like one; or it looks like nothing, and stays below
what alarms. A rest as rare as p speaks for something more by at most 1 / (−e p ln p) (Sellke, Bayarri and Berger, Am.
Stat. 55 (2001) 62).
"""

from collections.abc import Sequence

import numpy as np

from station.diagnosis.search.alarm import chance_of
from station.diagnosis.search.finding import UNLIKELY, CauseFinding
from station.diagnosis.search.form_check import PRIOR_NATS

#: Rests at least as usual as this speak for nothing more.
USUAL = float(np.exp(-1))


def as_certain_together(
    findings: Sequence[CauseFinding], statistic: float, threshold: float
) -> tuple[CauseFinding, ...]:
    """The findings, none so certain that what is beside it or left speaks against. statistic: of the rest, which alarms
    from a threshold on."""
    doubted = [_over_rest(f, statistic, threshold) if _is_likely(f) else f for f in findings]
    return tuple(_beside_stronger(f, doubted) if _is_likely(f) else f for f in doubted)


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
