"""What a gold reference in the nest says of gravity, and of itself, wherever its readings stand beside the unit's.

Only the length of the gold's reading is looked at, position by position: a tilt of rig or nest does not change it.
Along the nominal direction â (in the nest's frame) it reads too much by γ·|a| where gravity is not what the recipe
says, and by c·â where the gold has moved; its certificate leaves an offset and a gain of each axis open, whose spread
is part of the noise. γ and c are told apart by the positions, and given as a pair that cannot be told apart where these
do not.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults import gold_course
from station.diagnosis.data.faults.gross_fault import BlockGain, FaultParameter, GrossFault
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.effect import stimulus_strength
from station.model.effects.gold_drift import GoldDrift
from station.model.effects.local_gravity import LocalGravity
from station.model.scene import Scene

#: What is open where a certificate is silent: offset as a part of the stimulus, and gain, one standard deviation.
OFFSET_STD, GAIN_STD = 1e-4, 5e-5
#: Rise of χ² beyond which 1, 2, 3 or 4 numbers are no chance: 5 in 100,000.
CHI2_RISES = (0.0, 16.4, 19.8, 22.6, 24.9)
#: Two causes are told apart from this d·√κ on (docs/diagnosis.md).
GOLD_SEPARATION = 3.29
#: The part of a dwell in which nothing moves any more.
QUIET_FROM = 0.4
#: Rounds in which what the gold moved across the direction, which lengthens its reading by the square, is taken off.
ROUNDS = 2


@dataclass(frozen=True, slots=True, eq=False)
class GoldLengths:
    """Of each position (p): how much longer the gold's reading is than it should be; the nominal direction (p, 3) in
    the nest's frame and length; covariance (p, p). every, place (v): excess of each visit, and its position."""

    excess: Floats
    direction: Floats
    length: Floats
    covariance: Floats
    every: Floats
    place: NDArray[np.intp]

    def held_out_gain(self, columns: Floats, others: Floats) -> BlockGain | None:
        """What columns (p, k) say, beside others (p, l) that are known, of visits that they were not fitted to."""
        both = np.concatenate([columns, others], axis=1)
        known = others @ self.fit(both)[0][columns.shape[1] :]
        return gold_course.held_out_gain(self.every - known[self.place], columns[self.place])

    def fit(self, columns: Floats) -> tuple[Floats, Floats, float]:
        """Coefficients of columns (p, k), their covariance, and by how much χ² falls."""
        white = np.linalg.inv(np.linalg.cholesky(self.covariance))
        X, y = white @ columns, white @ self.excess
        covariance: Floats = np.asarray(np.linalg.pinv(X.T @ X, 1e-9, hermitian=True), float)
        found = covariance @ (X.T @ y)
        return found, covariance, float(y @ X @ found)


def testable_causes(recipe: Recipe, table: SampleTable) -> tuple[str, ...]:
    """The causes that these data can show."""
    if table.gold is None or not recipe.pose_known or recipe.reference.source == "rate":
        return ()
    return tuple(kind.id for kind in (GoldDrift, LocalGravity) if kind.acts_on(recipe))


def faults(recipe: Recipe, table: SampleTable, scene: Scene, visit: NDArray[np.intp]) -> list[GrossFault]:
    """Gravity that is not what the recipe says, and a gold that has moved; nothing without a gold."""
    causes = testable_causes(recipe, table)
    if not causes or table.gold is None:
        return []
    lengths = _lengths(recipe, scene, _quiet_means(table, visit, table.gold), moves="gold-drift" in causes)
    columns = {"gold-drift": lengths.direction, "local-gravity": lengths.length[:, None]}
    falls = {name: lengths.fit(columns[name])[2] for name in causes}
    rank = {name: int(np.linalg.matrix_rank(columns[name], 1e-6)) for name in causes}
    first = max(causes, key=lambda name: falls[name] - CHI2_RISES[rank[name]])
    if falls[first] < CHI2_RISES[rank[first]]:
        return []
    chosen = [first]
    both = lengths.fit(np.concatenate([columns[name] for name in causes], axis=1))[2]
    chosen += [name for name in causes if name != first and both - falls[first] > CHI2_RISES[rank[name]]]
    like = tuple(name for name in causes if name not in chosen and falls[first] - falls[name] < GOLD_SEPARATION**2)
    found, covariance, fall = lengths.fit(np.concatenate([columns[name] for name in chosen], axis=1))
    std = np.sqrt(np.diag(covariance))
    made = []
    for i, (name, at) in enumerate(_coefficient_slices(chosen, columns)):
        nats = 0.5 * (fall if len(chosen) == 1 else both - falls[chosen[1 - i]])
        others = [np.zeros((len(lengths.length), 0)), *(columns[n] for n in chosen if n != name)]
        gain = lengths.held_out_gain(columns[name], np.concatenate(others, axis=1))
        made.append(replace(_fault(name, found[at], std[at], nats, recipe, like), gain=gain))
    return made


def course(recipe: Recipe, table: SampleTable, scene: Scene, visit: NDArray[np.intp]) -> gold_course.GoldCourse | None:
    """How the gold moved while the campaign ran, if it did."""
    if "gold-drift" not in testable_causes(recipe, table) or table.gold is None:
        return None
    first = np.flatnonzero(np.diff(visit, prepend=-1))
    t = table.time_s[first]
    # Without a clock of the campaign the runs are taken for one after the other.
    t = t + (table.values["started_s"][first] if "started_s" in table.values else table.run[first] * float(t.max()))
    found = gold_course.find(scene, _calibrated(recipe, _quiet_means(table, visit, table.gold)[0]), t)
    return None if found is None or found.gain is None or not found.gain.accepted else found


def calibrated_means(recipe: Recipe, table: SampleTable, visit: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """Mean reading (v, 3) of a table's gold in the quiet part of each visit, its own calibration taken off, and the
    variance (v) of such a mean."""
    assert table.gold is not None
    mean, variance = _quiet_means(table, visit, table.gold)
    return _calibrated(recipe, mean), variance


def _calibrated(recipe: Recipe, reading: Floats) -> Floats:
    """The gold's readings (v, 3) with its own calibration taken off."""
    own = recipe.reference.gold
    return reading if own is None else np.linalg.solve(np.array(own.matrix), (reading - own.offset).T).T


def without_gold_drift(recipe: Recipe, table: SampleTable, found: list[GrossFault]) -> SampleTable:
    """The table with the gold as it was when it was calibrated."""
    drift = next((f for f in found if f.effect == "gold-drift" and not f.indistinguishable_from), None)
    if drift is None or table.gold is None:
        return table
    offset = np.array([float(n.value) for n in drift.numbers])
    own = recipe.reference.gold
    return replace(table, gold=table.gold - (offset if own is None else np.array(own.matrix) @ offset))


def _coefficient_slices(chosen: list[str], columns: dict[str, Floats]) -> list[tuple[str, slice]]:
    """The chosen causes, and where their coefficients stand."""
    ends = np.cumsum([0, *(columns[name].shape[1] for name in chosen)])
    return [(name, slice(int(a), int(b))) for name, a, b in zip(chosen, ends[:-1], ends[1:], strict=True)]


def _fault(name: str, value: Floats, std: Floats, nats: float, recipe: Recipe, like: tuple[str, ...]) -> GrossFault:
    numbers: tuple[FaultParameter, ...]
    if name == "local-gravity":
        numbers = (FaultParameter("coefficient", None, "common", float(value[0]), float(std[0]), "1"),)
        sentence = f"the gold finds {1e6 * float(value[0]):+.0f} ppm more gravity than the recipe says"
    else:
        numbers = tuple(
            FaultParameter("offset", axis, "common", float(v), float(s), recipe.unit)
            for axis, v, s in zip("xyz", value, std, strict=True)
        )
        sentence = f"the gold reads {float(np.linalg.norm(value)):.2g} {recipe.unit} beside its certificate"
    return GrossFault(name, "common", numbers, sentence, nats, like)


def _quiet_means(table: SampleTable, visit: NDArray[np.intp], gold: Floats) -> tuple[Floats, Floats]:
    """Mean reading (v, 3) of the gold in the quiet part of each visit, and the variance (v) of such a mean."""
    count = np.bincount(visit)
    first = np.full(len(count), np.inf)
    last = np.full(len(count), -np.inf)
    np.minimum.at(first, visit, table.time_s)
    np.maximum.at(last, visit, table.time_s)
    quiet = table.time_s >= (first + QUIET_FROM * (last - first))[visit]
    rows, where = gold[quiet], visit[quiet]
    n = np.maximum(np.bincount(where, minlength=len(count)), 1)
    mean = np.stack([np.bincount(where, column, len(count)) / n for column in rows.T], 1)
    off = ((rows - mean[where]) ** 2).mean(axis=1)
    return mean, np.bincount(where, off, len(count)) / np.maximum(n - 1, 1) / n


def _lengths(recipe: Recipe, scene: Scene, still: tuple[Floats, Floats], *, moves: bool) -> GoldLengths:
    """The gold's readings position by position; moves: whether the gold may have moved."""
    found = _lengths_beside(recipe, scene, still, np.zeros(3))
    for _ in range(ROUNDS if moves else 0):
        both = np.concatenate([found.direction, found.length[:, None]], axis=1)
        found = _lengths_beside(recipe, scene, still, found.fit(both)[0][:3])
    return found


def _lengths_beside(recipe: Recipe, scene: Scene, still: tuple[Floats, Floats], drift: Floats) -> GoldLengths:
    """The same where the gold has moved by about drift (3): what is left of lengths is in proportion to the rest."""
    visits, own = scene.visits, recipe.reference.gold
    reading = _calibrated(recipe, still[0]) - drift
    nominal = np.einsum("vji,vj->vi", visits.nest_R, visits.stimulus)
    length = np.linalg.norm(nominal, axis=1)
    along = nominal / np.maximum(length, 1e-300)[:, None]
    excess = np.linalg.norm(reading, axis=1) * np.sign(np.sum(reading * along, axis=1)) - length + along @ drift
    code, count = visits.position.code, np.maximum(np.bincount(visits.position.code), 1)

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(code, values) / count)

    used = np.bincount(code) > 0
    between = float(np.mean((excess - mean(excess)[code]) ** 2)) * len(code) / max(len(code) - int(used.sum()), 1)
    noise = max(float(np.mean(still[1])), between, 1e-24)
    directions = np.stack([mean(column) for column in along.T], 1)[used]
    lengths = mean(length)[used]
    offset_std = (own.offset_std if own else 0.0) or OFFSET_STD * stimulus_strength(recipe)
    gain_std = (own.gain_std if own else 0.0) or GAIN_STD
    gains = directions**2 * lengths[:, None]
    covariance = np.diag(noise / count[used]) + offset_std**2 * directions @ directions.T
    covariance += gain_std**2 * gains @ gains.T + _gravity_std(recipe) ** 2 * np.outer(lengths, lengths)
    place = (np.cumsum(used) - 1)[code]
    return GoldLengths(mean(excess)[used], directions, lengths, covariance, excess, place)


def _gravity_std(recipe: Recipe) -> float:
    """How well the magnitude is known, relative; a std for anywhere on Earth is no knowledge of this place."""
    r = recipe.reference
    return r.relative_std() if r.source != "gravity" or r.site or r.gravimeter else 0.0
