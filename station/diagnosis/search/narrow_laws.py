"""Laws of one coefficient an axis, by themselves: a wide kernel pays for every direction of it, and a law that is weak
for so many of them may be plain in one.

What the readings leave under the floor is white, so that the best of many laws is judged by its own distribution: of n
free numbers the share R² that K columns explain leaves 1 − R² as Beta((n − K)/2, K/2), as often as there are laws. How
large a healthy walk is the readings hardly tell: what the largest one makes of a law speaks for none. What acts on one
axis alone, or in one unit, has fewer numbers than what acts everywhere, and is looked for as such.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.candidates.kernels import law_kernel
from station.diagnosis.candidates.law_families import LawFamily, law_families
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.eigen import eigenvectors
from station.diagnosis.linear.evidence import log_mean_exp
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.search.law_products import FamilySpace, LawProducts, course_rows, lengths
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.unseen import Unseen
from station.domain.core.types import Floats

#: Units and visits of the longest run in which laws are looked for: more show what they do to wide kernels, too.
MOST_UNITS, MOST_VISITS = 12, 120
#: Laws whose courses are laid out together.
AT_ONCE = 256
#: Sizes of a law's variance beside the noise over which its evidence is averaged.
RATIOS = np.geomspace(0.03, 300.0, 20)
#: Axes of which a law has a coefficient each.
AXES = 3
#: Laws are so alike that the rarest of them in noise comes no more often than such a share of the sum of all chances
#: says (0.2 to 0.7 at a sum of 1 in 100, 9,100 sets of noise in five campaigns).
ALIKE = 0.5
#: A direction that keeps less than this share of its squares beside what is known is lost in it.
LEAST_SHARE = 1e-6


class _Explained(NamedTuple):
    """Of some laws: log evidence, and how often noise explains as much."""

    nats: Floats
    chance: Floats


def laws_to_find(view: ResidualView) -> tuple[LawFamily, ...]:
    """The laws of these data; none of fleets and of long runs."""
    if view.grid.units > MOST_UNITS or view.grid.slot.shape[2] > MOST_VISITS:
        return ()
    return tuple(law_families(view))


def find_laws(problem: ScoringProblem, floor: NoiseFloor, families: Sequence[LawFamily]) -> dict[str, Unseen]:
    """What the laws of some families explain of the readings under a floor, under the names of their kernels."""
    spaces = [problem.space(at, moving=False) for at in _floors(problem, floor)] if families else []
    if not all(space.residual.any() for space in spaces):
        return {}
    found = [_of_family(problem, family, spaces, floor) for family in families]
    if not found:
        return {}
    nats, chance = (np.concatenate(each) for each in zip(*found, strict=True))
    laws = [law for family in families for _ in family.own for law in family.laws]
    names, shown = np.array([law_kernel((law.covariates,)) for law in laws]), np.isfinite(nats)
    # Close courses are many and alike: they take no more chances from all others than those from them.
    close = np.array([law.close for law in laws])
    kinds = [(kind, kind & shown) for kind in (close, ~close) if np.any(kind & shown)]
    seen = dict[str, Unseen]()
    for name in np.unique(names[shown]).tolist():
        parts = [(np.count_nonzero(kind), some) for kind, those in kinds if np.any(some := those & (names == name))]
        each = np.array([float(log_mean_exp(nats[some])) for _, some in parts])
        least = min(float(chance[some].min()) * count for count, some in parts)
        seen[name] = Unseen.of(float(log_mean_exp(each)), ALIKE * least * len(kinds))
    return seen


def _floors(problem: ScoringProblem, floor: NoiseFloor) -> Iterator[NoiseFloor]:
    """The floor, and the same with the largest walk that a healthy one may have."""
    yield floor
    most = float(np.sqrt(problem.upper[2]))
    if floor.walk < most < np.inf:
        yield NoiseFloor(floor.noise, floor.turn, most)


def _of_family(
    problem: ScoringProblem, family: LawFamily, spaces: Sequence[ResidualSpace], floor: NoiseFloor
) -> _Explained:
    """What each law of a family explains in the space that speaks least for it: at one level, then at the next."""
    layout, count = problem.view.layout, (len(family.own), len(family.laws))
    nats, chance = np.full(count, -np.inf), np.ones(count)
    seen = [FamilySpace.of(family, layout, space) for space in spaces]
    shapes = [tuple(len(course.T) for course in law.courses) for law in family.laws]
    for shape in dict.fromkeys(shapes):
        alike = [i for i, other in enumerate(shapes) if other == shape]
        for which in (alike[first : first + AT_ONCE] for first in range(0, len(alike), AT_ONCE)):
            courses = course_rows([family.laws[i].courses for i in which], layout)
            length = lengths(family, layout, courses) / floor.noise**2
            products = [space.products(courses) for space in seen]
            for level, own in enumerate(family.own):
                pairs = zip(products, spaces, strict=True)
                each = [_judged(_Equations.of(one, length, own=own), space) for one, space in pairs]
                nats[level, which] = np.min([x.nats for x in each], axis=0)
                chance[level, which] = np.max([x.chance for x in each], axis=0)
    return _Explained(nats.ravel(), chance.ravel())


class _Equations(NamedTuple):
    """Normal matrices (n, G, K, K) of laws, of each unit or of all together; what lies along the readings (n, G, K);
    length (n): of their columns before anything is known; units and columns of each that they have coefficients for."""

    normal: Floats
    along: Floats
    length: Floats
    units: int
    width: int

    @staticmethod
    def of(products: LawProducts, length: Floats, *, own: bool) -> "_Equations":
        """From the products of laws, of each unit on its own or all together."""
        normal, border, along = products if own else (x.sum(1, keepdims=True) for x in products)
        n, U, c = along.shape
        if border.shape[3]:
            whole = np.zeros((n, U, c, U, c))
            whole[:, np.arange(U), :, np.arange(U)] = normal.swapaxes(0, 1)
            flat = border.reshape(n, U * c, -1)
            normal = (whole.reshape(n, U * c, -1) - flat @ flat.swapaxes(1, 2))[:, None]
        return _Equations(normal, along.reshape(*normal.shape[:3]), length, U, c)

    def by_extent(self) -> Iterator[tuple[Floats, Floats]]:
        """Squares (n, some) that some columns explain, and how many directions of them are seen: all columns of so many
        a unit, those of each axis, which follow each other, and those of each unit."""
        (_, groups), units, width = self.normal.shape[:2], self.units, self.width
        every = np.arange(units * width // groups).reshape(-1, width)
        squares, seen = self._explained_by(every.reshape(1, -1))
        yield squares.sum(1), seen.sum(1)
        if width % AXES == 0:
            on_axis = every.reshape(len(every), -1, AXES).transpose(2, 0, 1).reshape(AXES, -1)
            along, shown = self._explained_by(on_axis)
            yield along.sum(1), shown.sum(1)
        if groups > 1:
            yield squares[..., 0], seen[..., 0]
        elif units > 1:
            squares, seen = self._explained_by(every)
            yield squares[:, 0], seen[:, 0]

    def _explained_by(self, chosen: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """Squares (n, G, some) that chosen columns (some, columns) explain, and how many directions are seen."""
        normal = self.normal[:, :, chosen[:, :, None], chosen[:, None]]
        # A column by itself has nothing to be told apart from.
        m, E = eigenvectors(normal) if chosen.shape[1] > 1 else (normal[..., 0], np.ones_like(normal))
        seen = m > LEAST_SHARE * self.length[:, None, None, None]
        u = (E.swapaxes(-1, -2) @ self.along[:, :, chosen, None])[..., 0]
        return np.where(seen, u**2 / np.where(seen, m, 1.0), 0.0).sum(-1), seen.sum(-1).astype(float)


def _judged(equations: _Equations, space: ResidualSpace) -> _Explained:
    """What laws explain: on all there is, on one axis alone, or in one unit: one of these, and in each one of some."""
    found = [_explained(*squares, space) for squares in equations.by_extent()]
    nats = _mean_of_shown(np.stack([x.nats for x in found], axis=1))
    return _Explained(nats, np.minimum(len(found) * np.min([x.chance for x in found], axis=0), 1.0))


def _explained(squares: Floats, numbers: Floats, space: ResidualSpace) -> _Explained:
    """What laws explain by the squares (n, some) of some of their columns, of which they have one alone, and by so many
    numbers."""
    share = np.minimum(squares / space.rest, 1 - 1e-9)
    shown, grown = (numbers > 0) & (numbers < space.dof), (RATIOS / (1 + RATIOS))[:, None, None]
    each = -0.5 * space.dof * np.log1p(-grown * share) - 0.5 * numbers * np.log1p(RATIOS)[:, None, None]
    nats = np.where(shown, log_mean_exp(np.moveaxis(each, 0, -1)), -np.inf)
    choices = shown.shape[1]
    if np.all(numbers == numbers[:, :1]):
        # Of as many numbers the largest share is the rarest.
        share, numbers, shown = share.max(axis=1, keepdims=True), numbers[:, :1], shown[:, :1]
    free = np.where(shown, space.dof - numbers, 1.0)
    chance = scipy.special.betainc(free / 2, np.maximum(numbers, 1) / 2, 1 - share)
    least = np.where(shown, chance, 1.0).min(axis=1)
    return _Explained(_mean_of_shown(nats), np.minimum(choices * least, 1.0))


def _mean_of_shown(nats: Floats) -> Floats:
    """The log evidence (n) of laws that are one of some choices (n, some), −∞ where none is shown."""
    shown = np.max(nats, axis=1) > -np.inf
    return np.where(shown, log_mean_exp(np.where(np.reshape(shown, (-1, 1)), nats, 0.0)), -np.inf)
