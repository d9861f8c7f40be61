"""The form of each promising cause at its best: its time constant, its frequency, its time of a jump."""

from station.diagnosis.candidates.bank import Candidate, build_bank
from station.diagnosis.candidates.dwell_kernels import MOVING_KERNEL
from station.diagnosis.candidates.kernels import KERNEL_NAMES
from station.diagnosis.candidates.shape import (
    evidence_of,
    has_jump,
    may_ring,
    refine_jump_time,
    tunable_parameters,
    tune_form,
    with_ringing,
)
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.search.alarm import UNKNOWN_NATS
from station.diagnosis.search.jump_times import at_own_times
from station.diagnosis.search.rank import RankedCause
from station.diagnosis.search.scoring import ScoringProblem, score_bank

#: Share of the leading evidence from which a cause is worth tuning.
PROMISING_SHARE = 0.25


def tune_forms(problem: ScoringProblem, ranks: dict[str, RankedCause]) -> dict[str, RankedCause]:
    """The same with the form of each promising cause at its best."""
    top = max((r.evidence for r in ranks.values()), default=0.0)
    leads = any(r.evidence == top for name, r in ranks.items() if name in KERNEL_NAMES)
    # What rings changes within the dwells: where no course within them is left, there is nothing to look for.
    rings = leads and MOVING_KERNEL in ranks and ranks[MOVING_KERNEL].evidence > 0
    for name, r in ranks.items():
        if r.best is None or r.best.effect is None:
            continue
        # Without its waves a cause that rings explains next to nothing.
        if r.evidence < PROMISING_SHARE * top and not (rings and may_ring(r.best.effect)):
            continue
        space = problem.space(r.at.floor, moving=r.best.moving)
        best = _with_best_form(r.best, problem.view, space)
        if rings and may_ring(r.best.effect):
            ringing = with_ringing(r.best, problem.view, space)
            quiet, loud = (evidence_of(c, problem.view, space) for c in (best, ringing))
            # A frequency is one more thing to choose: it must pay for itself.
            best = ringing if loud > quiet + UNKNOWN_NATS else best
        paid = 0.0
        if has_jump(best.effect) and (own := at_own_times(problem, r.best, r.at)) is not None:
            best, paid = own
        if best is not r.best:
            gain = evidence_of(best, problem.view, space) - evidence_of(r.best, problem.view, space) - paid
            if paid and gain <= 0:
                continue
            bank = build_bank([best], problem.view.layout, moving=best.moving)
            ranks[name] = RankedCause(name, r.evidence + max(gain, 0.0), best, score_bank(problem, [bank], r.at.floor))
    return ranks


def _with_best_form(candidate: Candidate, view: ResidualView, space: ResidualSpace) -> Candidate:
    """The candidate with its form at its best."""
    best = refine_jump_time(candidate, view, space) if has_jump(candidate.effect) else candidate
    return tune_form(best, view, space)[0] if tunable_parameters(best.effect) else best
