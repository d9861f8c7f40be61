"""A limit as it is decided (JCGM 106:2012, ILAC-G8:09/2019): one rule for whatever has a value and an uncertainty."""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.domain.methods import coverage
from station.domain.recipe.blocks import Limits
from station.messages import Message


@dataclass(frozen=True, slots=True)
class Decision:
    """One limit as it was decided: what, in which unit, value and U, limit, guard band, and the specific risk that the
    true value is beyond the limit."""

    what: str
    unit: str
    value: float
    expanded: float | None
    limit: float
    guard: float
    false_accept: float | None

    @property
    def margin(self) -> float:
        """Room to the acceptance limit; negative where it is exceeded."""
        return self.limit - self.guard - abs(self.value)

    @property
    def accepted(self) -> bool:
        """Whether the rule accepts the value; no number is not accepted."""
        return abs(self.value) <= self.limit - self.guard


def rule_of(limits: Limits) -> Message:
    """The decision rule in words."""
    if limits.rule == "guard-band":
        return Message("rule-guard-band")
    if limits.rule == "false-accept":
        return Message("rule-false-accept", probability=limits.false_accept)
    return Message("rule-simple")


def guard_band(limits: Limits, error: coverage.ErrorDistribution) -> Floats:
    """w of the decision rule: 0; U; or the one-sided quantile that keeps a false accept at the limit rare."""
    if limits.rule == "guard-band":
        return error.expanded()
    if limits.rule == "false-accept" and limits.false_accept is not None:
        return error.quantile(1 - limits.false_accept)
    return np.zeros_like(error.std)


def decide_limit(
    limits: Limits, of: tuple[str, str], value: float, std: float, limit: float, dof: float = coverage.MANY
) -> Decision:
    """The decision on a value of which nothing was known before. of: what it is, and its unit; std: u of the value."""
    error = coverage.ErrorDistribution.plain(np.array([std]), np.array([dof]))
    wide, guard = float(error.expanded()[0]), float(guard_band(limits, error)[0])
    beyond = error.tail(np.array([limit - value])) + error.tail(np.array([limit + value]))
    return Decision(*of, value, wide or None, limit, guard, float(beyond[0]))
