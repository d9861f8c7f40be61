"""What a next run promises: the chance that the diagnosis after it leaves a single cause, the right one.

Were one of a tie the true cause, the next diagnosis estimates how far another is from it, d·√κ, with a standard error
of 1, and parts the two where the estimate is above 3.29. The size is known from a strength d so far, that is to 1/d of
itself, and what is planned grows and shrinks with it: a pair planned at x is parted with chance
Φ((x − 3.29) / √(1 + (x/d)²)). All others of the tie are held against the same readings, so whatever parts the true
cause from the one that is nearest to it parts it from the rest. Which of the tie is true the evidence says but by half:
among causes of no more coefficients most of a lead is the error of a covariate, of a shape or of a typical size. Of
causes of more coefficients it says all: that many of them are what few explain is as unlikely as it says.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import erf, inf, prod, sqrt

from station.diagnosis.search.distinguishability import SEPARATION_95

#: What the evidence within a tie counts for; the rest is shared alike. Of 45 ties of slow causes on benches that warm
#: the leader was the true one in 12, where its evidence gave it .54 in the mean.
EVIDENCE_SHARE = 0.5
#: Steps that find a number to a millionth of its range.
HALVINGS = 20
#: Two causes of a tie by id: the true one, and another.
TrueAndOther = tuple[str, str]


@dataclass(frozen=True, slots=True)
class TiedCauses:
    """The causes of a tie, the one found first; how likely each is, together 1; and the strength d it was found at."""

    names: tuple[str, ...]
    likely: tuple[float, ...]
    d: float

    @staticmethod
    def of(
        names: Sequence[str], d: float, probability: Mapping[str, float], numbers: Sequence[int] = ()
    ) -> "TiedCauses":
        """From probabilities by name, all alike where none is given, which count by EVIDENCE_SHARE among those of no
        more coefficients than the one found; numbers: of each. None is likelier than the one found: it leads by more
        than its evidence."""
        each = [probability.get(name, 0.0) for name in names] if probability else []
        each = [min(p, each[0]) for p in each]
        total, count = sum(each), len(names)
        shares = [p / total for p in each] if total > 0 else [1 / count] * count
        few = [n <= numbers[0] for n in numbers] if numbers else [True] * count
        alike = sum(p for p, one in zip(shares, few, strict=True) if one) / sum(few)
        others = [alike if one else p for p, one in zip(shares, few, strict=True)]
        likely = (EVIDENCE_SHARE * p + (1 - EVIDENCE_SHARE) * q for p, q in zip(shares, others, strict=True))
        return TiedCauses(tuple(names), tuple(likely), d)

    def chance_parted(self, apart: float) -> float:
        """Chance that two causes planned at d·√κ are parted."""
        spread = sqrt(1 + (apart / max(self.d, 1.0)) ** 2)
        return 0.5 * (1 + erf((apart - SEPARATION_95) / spread / sqrt(2)))

    def as_one(self, apart: Sequence[float], shares: Sequence[float]) -> float:
        """The d·√κ at which two causes are parted with the mean chance of those at which they may be, by their shares:
        a cause is known no better than its time constant is. By halving."""
        wanted = sum(w * self.chance_parted(x) for x, w in zip(apart, shares, strict=True))
        low, high = min(apart), max(apart)
        for _ in range(HALVINGS if low < high else 0):
            middle = (low + high) / 2
            low, high = (middle, high) if self.chance_parted(middle) < wanted else (low, middle)
        return high


@dataclass(frozen=True, slots=True)
class Promise:
    """d·√κ of each of the causes of some ties, were it the true one, against each other of its tie and each that only
    the new runs can show; simulated: of pairs in the order of their names the share of simulated diagnoses that part
    them where one of them is true."""

    ties: tuple[TiedCauses, ...]
    apart: Mapping[TrueAndOther, float]
    simulated: Mapping[TrueAndOther, float] = field(default_factory=dict)

    @property
    def separates(self) -> tuple[str, ...]:
        """The causes found and those likely to be parted from them; where none is, what is parted at all."""
        parted = [pair for pair in self._pairs() if self._chance_of_pair(*pair) > 0.5]
        heads = {tie.names[0] for tie in self.ties}
        named = [pair for pair in parted if set(pair) & heads]
        return tuple(dict.fromkeys(name for pair in named or parted for name in pair))

    @property
    def leaves(self) -> tuple[str, ...]:
        """Causes that stay tied with another of the same tie."""
        tied = [pair for pair in self._pairs() if self._chance_of_pair(*pair) <= 0.5]
        return tuple(dict.fromkeys(name for pair in tied for name in pair))

    @property
    def certainty(self) -> float:
        """Chance that the next diagnosis names the true cause of each tie alone."""
        return prod(
            sum(p * self._chance(true, tie) for true, p in zip(tie.names, tie.likely, strict=True)) for tie in self.ties
        )

    def _pairs(self) -> list[TrueAndOther]:
        """Each pair once."""
        return sorted({(min(pair), max(pair)) for pair in self.apart})

    def _chance_of_pair(self, one: str, other: str) -> float:
        """Chance that two causes are parted if one of them is the true one."""
        if (one, other) in self.simulated:
            return self.simulated[one, other]
        tie = next(tie for tie in self.ties if {one, other} & set(tie.names))
        likely = dict(zip(tie.names, tie.likely, strict=True))
        pairs = [pair for pair in ((one, other), (other, one)) if pair in self.apart]
        weights = [max(likely.get(true, 0.0), 1e-300) for true, _ in pairs]
        chances = [tie.chance_parted(self.apart[pair]) for pair in pairs]
        return sum(w * p for w, p in zip(weights, chances, strict=True)) / sum(weights)

    def _chance(self, true: str, tie: TiedCauses) -> float:
        return tie.chance_parted(min((x for (one, _), x in self.apart.items() if one == true), default=inf))
