"""One law on several axes, found axis by axis, merged into one term.

The scan tries all axes of a product together and each alone. A law in which each axis follows another one, or with too
many coefficients for all pairs at once, is found as several terms of one family, each with a frequency or time constant
of its own. The same happens to the remainder of a first term whose constant was fitted while the rest of the law was
still in the data. The signal left on another axis may be weak; noise then decides which family leads there, and one law
is more likely than two if the data cannot separate them.
"""

from collections.abc import Sequence

from station.diagnosis.discovery.equivalent_terms import other_families, unparted
from station.diagnosis.discovery.term_fit import TermFit, TermSpaces, fit_term, refine, with_levels
from station.diagnosis.search.scoring import ScoringProblem
from station.model.formula.grammar import columns_of
from station.model.formula.term import Term

#: A term and those that cannot be told from it.
Spellings = Sequence[TermFit]


class TermPair:
    """Two terms accepted by a problem, each with those that the data cannot separate from it; bare: the problem without
    them."""

    def __init__(self, problem: ScoringProblem, first: int, second: int, one: Spellings, two: Spellings) -> None:
        self._one, self._two = one, two
        self._with_one = problem.without(second)
        self.bare = self._with_one.without(first)
        self._floor = problem.fit().floor
        self._spaces = TermSpaces(self.bare, self._floor)

    def as_one(self, levels: tuple[str, ...]) -> TermFit | None:
        """Both as one term of a family that either may be, with the constants of either fitted anew; None where two
        terms explain more."""
        others = {f.term.family: f.term for f in reversed(self._two)}
        pairs = [(f.term, others[f.term.family]) for f in self._one if f.term.family in others]
        fits = [refine(t.with_axes({*a.axes, *b.axes}), self._spaces.of(t)) for a, b in pairs for t in (a, b)]
        if not fits:
            return None
        leader = max(fits, key=lambda f: f.odds)
        best = with_levels(leader, self._spaces.of(leader.term), levels)
        return best if best.score >= self._score_apart() else None

    def _score_apart(self) -> float:
        """The score of both terms, one after the other."""
        one, two, then = self._one[0].term, self._two[0].term, TermSpaces(self._with_one, self._floor)
        return fit_term(one, self._spaces.of(one)).score + fit_term(two, then.of(two)).score

    def score(self, one: TermFit) -> float:
        """The score of one term, the floor at its best with it and without."""
        without = TermSpaces(self.bare, self.bare.fit().floor).of(one.term).space
        return one.score + self._spaces.of(one.term).space.profile - without.profile

    def rivals(self, one: TermFit, levels: tuple[str, ...]) -> tuple[TermFit, ...]:
        """What either term might have been that cannot be told from one term, on its axes."""
        former = [f.term for f in (*self._one, *self._two)]
        terms = {t.family: _on_axes_of(t, one.term) for t in former if t.family != one.term.family}
        fits = [with_levels(refine(t, self._spaces.of(t)), self._spaces.of(t), levels) for t in terms.values()]
        return other_families(unparted(fits, one, self._spaces), one, self.bare.view.scene)


def _on_axes_of(term: Term, like: Term) -> Term:
    """A term with the coefficients that act where another's do."""
    same = term.factors[0].layout == like.factors[0].layout
    places = {(c.i, c.j if same else 0) for c in like.columns}
    return term.with_axes({c.label for c in columns_of(*term.factors) if (c.i, c.j if same else 0) in places})
