"""What U means, everywhere: U = k·u, the half-width that holds the error with PROBABILITY (JCGM 101, 7.7).

An error is a sum of three: what is normal, or Student's t where its size is an estimate (JCGM 100, annex G); a
rectangle, where few readings were rounded; and what a converter that cuts off takes of all readings, or not. Without
the last two, k is Student's quantile of the effective degrees of freedom.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from station.domain.core.types import Floats

#: Coverage probability of every expanded uncertainty.
PROBABILITY = 0.95
#: More degrees of freedom than this change no digit.
MANY = 1e6
#: Effective degrees of freedom of what is known; of a small part of an error that has many, few may be left.
KNOWN = 1e18
#: The same quantile of the normal distribution, Φ⁻¹(0.975); a number, since scipy takes a quarter of a second to load.
NORMAL = 1.959963984540054
#: A rectangle of no more than this share of u changes k by less than 1e-5 of it, a shift of no more than that one by
#: less than 3e-4: they are left out.
NARROW, SMALL = 0.1, 0.03
#: Standard uncertainty of a shift that is there or not, in shifts.
SHIFT_STD = 2 / 3
#: Newton's steps to a quantile: the distribution is concave there, so that they arrive from below.
STEPS = 30
#: A step below this share of the quantile changes no digit.
ARRIVED = 1e-10


@dataclass(frozen=True, slots=True, eq=False)
class ErrorDistribution:
    """Of errors (…): standard uncertainty u and effective degrees of freedom ν of the whole; half-width of the
    rectangle in it; and by how much it may be shifted to one side, or not.

    The rest is Student's t with u² − rectangle²/3 − (2·shift/3)² and ν times the square of that share of u².
    """

    std: Floats
    dof: Floats
    rectangle: Floats
    shift: Floats

    @staticmethod
    def plain(std: Floats, dof: Floats) -> "ErrorDistribution":
        """Without a rectangle and a shift."""
        nothing = np.zeros_like(std)
        return ErrorDistribution(std, dof, nothing, nothing)

    def telling(self) -> "ErrorDistribution":
        """Without rectangles and shifts that change no digit."""
        rectangle = np.where(self.rectangle > NARROW * self.std, self.rectangle, 0.0)
        return replace(self, rectangle=rectangle, shift=np.where(self.shift > SMALL * self.std, self.shift, 0.0))

    def take(self, *which: slice | NDArray[np.intp] | NDArray[np.bool_]) -> "ErrorDistribution":
        """Some of the errors."""
        return ErrorDistribution(*(getattr(self, f.name)[which] for f in fields(self)))

    def expanded(self) -> Floats:
        """U (…): the error is within ± U with PROBABILITY, shifted or not."""
        return self._found(PROBABILITY, two_sided=True)

    def quantile(self, probability: float) -> Floats:
        """What the error (…) stays below with that probability, shifted or not."""
        return self._found(probability, two_sided=False)

    def tail(self, x: Floats) -> Floats:
        """Probability (…) that the error is above x, a shift being there as likely as not."""
        out = np.asarray(scipy.special.stdtr(np.clip(self.dof, 1.0, MANY), -x / np.maximum(self.std, 1e-300)))
        for which in self._mixed():
            some, at = self.take(which), x[which]
            rest = some._rest()
            out[which] = np.maximum(1 - (rest.below(at)[0] + rest.below(at - some.shift)[0]) / 2, 0.0)
        return out

    def _found(self, probability: float, *, two_sided: bool) -> Floats:
        level = (1 + probability) / 2 if two_sided else probability
        out = np.asarray(quantile(self.dof, level) * self.std)
        for which in self._mixed():
            some = self.take(which)
            out[which] = some._rest().quantile(probability, some.shift, two_sided=two_sided)
        return out

    def _mixed(self) -> Iterator[NDArray[np.bool_]]:
        """Which errors are more than Student's t: without a rectangle, and with one."""
        for which in ((self.rectangle <= 0) & (self.shift > 0), self.rectangle > 0):
            if which.any():
                yield which

    def _rest(self) -> "_Rounded":
        variance = self.std**2
        rest = variance - self.rectangle**2 / 3 - (SHIFT_STD * self.shift) ** 2
        # Never nothing: rounding of the sums.
        rest = np.maximum(rest, 1e-6 * variance)
        return _Rounded(np.sqrt(rest), np.clip(self.dof * (rest / variance) ** 2, 1.001, MANY), self.rectangle)


@dataclass(frozen=True, slots=True, eq=False)
class _Rounded:
    """s·t of ν degrees of freedom (n) plus a rectangle of half-width a (n), of all or of none."""

    std: Floats
    dof: Floats
    half: Floats

    def quantile(self, probability: float, shift: Floats, *, two_sided: bool) -> Floats:
        """x (n) that the shifted sum, or its absolute value, is below with that probability."""
        # A rectangle and the other side only widen: there is no less than this.
        x, moving = shift + self.std * quantile(self.dof, probability), np.arange(len(shift))
        for _ in range(STEPS):
            some, own, at = self.take(moving), shift[moving], x[moving]
            held, density = some.below(at - own)
            if two_sided:
                beyond, more = some.below(-at - own)
                held, density = held - beyond, density + more
            by = np.maximum(probability - held, 0.0) / np.maximum(density, 1e-300)
            x[moving] += by
            # Each stops by itself, so that its bits do not depend on its neighbours.
            moving = moving[by > ARRIVED * x[moving]]
            if not len(moving):
                break
        return x

    def take(self, which: NDArray[np.intp]) -> "_Rounded":
        """Some of them."""
        return _Rounded(self.std[which], self.dof[which], self.half[which])

    def below(self, x: Floats) -> tuple[Floats, Floats]:
        """Probability (n) of less than x, and the density there."""
        at, stdtr = x / self.std, scipy.special.stdtr
        if not self.half.any():
            return stdtr(self.dof, at), self._density(at) / self.std
        # Hardly any rectangle is one of a thousandth.
        half = np.maximum(self.half / self.std, 1e-3)
        low, high = at - half, at + half
        to_low, to_high = stdtr(self.dof, low), stdtr(self.dof, high)
        held = (self._integral(high, to_high) - self._integral(low, to_low)) / (2 * half)
        return held, (to_high - to_low) / (2 * half * self.std)

    def _density(self, x: Floats) -> Floats:
        """f of Student's t."""
        nu, gammaln = self.dof, scipy.special.gammaln
        log = gammaln((nu + 1) / 2) - gammaln(nu / 2) - np.log(nu * np.pi) / 2 - (nu + 1) / 2 * np.log1p(x**2 / nu)
        return np.asarray(np.exp(log))

    def _integral(self, x: Floats, below: Floats) -> Floats:
        """∫ F dx = x·F + (ν + x²)/(ν − 1)·f of Student's t; below: F."""
        return np.asarray(x * below + (self.dof + x**2) / (self.dof - 1) * self._density(x))


def factor(dof: Floats) -> Floats:
    """k of an interval that holds PROBABILITY, for effective degrees of freedom (…)."""
    return quantile(dof, (1 + PROBABILITY) / 2)


def quantile(dof: Floats, probability: float) -> Floats:
    """Student's one-sided quantile for degrees of freedom (…)."""
    return np.asarray(scipy.special.stdtrit(np.clip(dof, 1.0, MANY), probability))


def effective_dof(total: Floats, parts: list[tuple[Floats, Floats]]) -> Floats:
    """Welch–Satterthwaite (JCGM 100, eq. G.2b) of a variance (…) whose parts, variance and degrees of freedom (…)
    each, are estimates; what is not among the parts is known."""
    spread = sum((part**2 / np.maximum(dof, 1e-3) for part, dof in parts), np.zeros_like(total))
    return np.asarray(np.minimum(total**2 / np.maximum(spread, 1e-300), KNOWN))
