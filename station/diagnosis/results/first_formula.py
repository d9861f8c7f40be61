"""A single formula in place of several causes, looked for before them.

Where no cause follows most of the signal, several causes that each share a little with one law are found one after the
other, at the price of several passes over the whole bank. A formula of one term that leaves only noise replaces them in
the end (`imitators.py`), so it is looked for first, and what is found here is not looked for again.
"""

import numpy as np

from station.diagnosis.discovery.discover import AlarmOnRest, Discovery, discover
from station.diagnosis.discovery.rest import visit_noise
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.held_out_gain import held_out_gain
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.search_state import CauseSearch, LawAlone

#: Seed of the null distribution over the grammar.
SEED = 1
#: A cause that explains less than this share of all there is to explain leaves a law to be looked for, where there are
#: so many nats: of less the causes are soon found.
FOLLOWED_SHARE, LEAST_NATS = 0.7, 200.0
#: A formula stands alone that explains so much more than any cause, and than any kernel, which follows much.
AHEAD_OF_CAUSES, AHEAD_OF_KERNELS = 1.3, 1.1


def law_alone(search: CauseSearch, cause_nats: float, kernel_nats: float) -> LawAlone | None:
    """The formula of at most one term that explains everything before any cause is known, and whether nothing else need
    be looked for; None where the best cause leaves too little for a formula."""
    problem = search.first.problem
    every = _explainable_nats(problem)
    if search.null is None or every < LEAST_NATS or cause_nats > FOLLOWED_SHARE * every:
        return None
    found = discover(problem, AlarmOnRest(search.null, search.undetectable, search.banks), SEED, most_terms=1)
    least = max(AHEAD_OF_CAUSES * cause_nats, AHEAD_OF_KERNELS * kernel_nats)
    numbers = sum(term.fit.coefficients for term in found.terms)
    return LawAlone(found, _is_whole(found, least), numbers)


def _is_whole(found: Discovery, least: float) -> bool:
    """Whether a formula leaves nothing, held-out data confirm it, and it explains enough."""
    if not found.quiet or found.terms[0].score < least:
        return False
    return held_out_gain(found.problem, found.first, found.problem.fit().floor).accepted


def _explainable_nats(problem: ScoringProblem) -> float:
    """The log-likelihood gained if everything were explained except what the largest healthy floor makes."""
    noise = visit_noise(problem).noise
    if noise <= 0:
        return 0.0
    turn, walk = (float(x) for x in np.sqrt(problem.upper[1:]))
    space = problem.space(NoiseFloor(noise, turn, walk), moving=False)
    return 0.5 * space.dof * float(np.log(max(space.rest / max(space.dof, 1), 1.0)))
