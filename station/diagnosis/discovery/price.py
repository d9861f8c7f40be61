"""The description length of a formula in nats: the price of a choice, which the data must pay for.

Counted are the nodes of the tree, the choice of axes and of the level of sharing, and each free constant to the
precision that some hundred numbers give it (Bartlett, Desmond, Ferreira, IEEE Trans. Evol. Comp. 28 (2024) 950). A node
costs half a nat: of two trees the longer is slightly less likely beforehand, and the data soon outweigh that. A corner
or a jump at some value is an event that laws of most devices do without: its tree is the longer one.
"""

from functools import cache

import numpy as np

from station.model.formula.expression import constants, size
from station.model.formula.grammar import INPUTS, MODULATORS, columns_of
from station.model.formula.term import Term

#: A node of the tree, a free constant, a level of sharing other than the unit's or everybody's; nats.
NODE_NATS, CONSTANT_NATS, RARE_LEVEL_NATS = 0.5, 1.0, 1.5
#: A clock that starts with power or clamp: where all start together, the run's own is the plainer way to say it.
CLOCK_NATS, CLOCKS = 0.5, frozenset({"since_power_s", "since_clamp_s"})


def price(term: Term) -> float:
    """Description length of a term without its coefficients, nats."""
    return family_price(*term.family, len(term.axes)) + (0.0 if term.of in ("unit", "common") else RARE_LEVEL_NATS)


@cache
def family_price(input_: str, modulator: str, axes: int) -> float:
    """The same of any term of so many axes, with a coefficient of each unit or of everybody."""
    factors = INPUTS[input_], MODULATORS[modulator]
    every = len(columns_of(*factors))
    choice = float(np.log(2)) if axes == every else float(np.log(2 * every / axes))
    clock = CLOCK_NATS * len(CLOCKS & {need for f in factors for need in f.needs})
    fields = {field for f in factors for field in constants(f.tree)}
    return NODE_NATS * sum(size(f.tree) for f in factors) + CONSTANT_NATS * len(fields) + choice + clock
