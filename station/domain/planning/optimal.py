"""Which positions tell most: D-optimal search over directions (Fedorov's exchange) for whatever method a recipe has."""

import numpy as np

from station.domain.core import rotation
from station.domain.core.types import Floats
from station.domain.methods import method
from station.domain.recipe.directions import CANDIDATES, SOLIDS, spread
from station.domain.recipe.recipe import Recipe

#: Information that a design is given beforehand, so that incomplete ones can be compared too.
PRIOR = 1e-6
#: Passes of exchange, and rotations tried on top of the known solids.
PASSES = 12


def log_det(true: Floats, recipe: Recipe) -> float:
    """ln det(XᵀX)^(1/k) of the method's design of truths (v, 3)."""
    X = _rows(true, recipe)
    return float(np.linalg.slogdet(X.T @ X + PRIOR * np.eye(X.shape[1]))[1] / X.shape[1])


def next_best(true: Floats, recipe: Recipe) -> Floats:
    """The truth (3) that raises det XᵀX most when added to truths (v, 3)."""
    X = _rows(true, recipe)
    inverse = np.asarray(np.linalg.inv(X.T @ X + PRIOR * np.eye(X.shape[1])), float)
    gain = _gains(inverse, _candidates(recipe, true))
    # Equal to the last digit means equal: the easier direction, listed first, wins.
    best = int(np.argmax(gain >= gain.max() - 1e-9 * abs(gain.max())))
    return np.asarray(_truths(true)[best])


def search(recipe: Recipe, count: int) -> Floats:
    """The best truths (count, 3) found: known solids and even spreads, improved by exchange."""
    strength = _strength(recipe)
    starts = [spread(count)] + ([SOLIDS[count]] if count in SOLIDS else [])
    halves = [n for n in SOLIDS if count % n == 0]
    starts += [np.tile(SOLIDS[n], (count // n, 1)) for n in halves]
    found = [_exchange(recipe, start * strength) for start in starts]
    scores = [log_det(f, recipe) for f in found]
    # Of designs that are as good, the solid nobody had to bend.
    best = max(range(len(found)), key=lambda i: (round(scores[i], 6), i))
    return found[best]


def _exchange(recipe: Recipe, true: Floats) -> Floats:
    """Swaps one position at a time for a better candidate until none is (Fedorov 1972, ch. 3)."""
    candidates = _truths(true)
    C = _candidates(recipe, true)
    for _ in range(PASSES):
        before = log_det(true, recipe)
        for i in range(len(true)):
            rest = _rows(np.delete(true, i, axis=0), recipe)
            inverse = np.asarray(np.linalg.inv(rest.T @ rest + PRIOR * np.eye(rest.shape[1])), float)
            gain, own = _gains(inverse, C), _gains(inverse, _stacked(recipe, true[i : i + 1]))[0]
            if gain.max() > own + 1e-6 * abs(own):
                true = np.concatenate([true[:i], candidates[int(gain.argmax())][None], true[i + 1 :]])
        if log_det(true, recipe) < before + 1e-9:
            break
    return true


def _gains(inverse: Floats, stacked: Floats) -> Floats:
    """ln det(I + C M⁻¹ Cᵀ) for candidates' rows C (c, r, k)."""
    inner = stacked @ inverse @ stacked.transpose(0, 2, 1)
    return np.asarray(np.linalg.slogdet(np.eye(stacked.shape[1]) + inner)[1])


def _rows(true: Floats, recipe: Recipe) -> Floats:
    return method.of(recipe).design(true, recipe, np.zeros((len(true), 0)))[0]


def _stacked(recipe: Recipe, true: Floats) -> Floats:
    """Rows (c, r, k) of each truth by itself."""
    return np.stack([_rows(t[None], recipe) for t in true])


def _truths(true: Floats) -> Floats:
    return CANDIDATES * float(np.linalg.norm(true, axis=1).max())


def _candidates(recipe: Recipe, true: Floats) -> Floats:
    return _stacked(recipe, _truths(true))


def _strength(recipe: Recipe) -> float:
    if recipe.pose_known and recipe.positions:
        return max(float(np.linalg.norm(recipe.true_vector(p))) for p in recipe.positions)
    return recipe.reference.strength()


def as_yaml(name: str, true: Floats, recipe: Recipe) -> str:
    """A position of a recipe that makes `true` (3) the truth in the device's frame, seated at home."""
    if recipe.reference.source == "rate":
        return f"{{name: {name}, rate: [{_numbers(true)}]}}"
    field = recipe.stimulus(recipe.positions[0]) if recipe.positions else np.array([0.0, 0.0, 1.0])
    straight = np.abs(true).max() > (1 - 1e-9) * np.linalg.norm(true)
    if straight and field[2] > 0 and not field[:2].any():
        i = int(np.abs(true).argmax())
        return f"{{name: {name}, up: {'+' if true[i] > 0 else '-'}{'xyz'[i]}}}"
    turn = rotation.to_vector(rotation.shortest(true / np.linalg.norm(true), field / np.linalg.norm(field)))
    angle = float(np.linalg.norm(turn))
    if angle > np.pi - 1e-6:
        # A half turn has no rotation vector of its own; any axis across does.
        turn = np.cross(true, np.eye(3)[int(np.abs(true).argmin())])
    axis = turn / np.abs(turn).max()
    return f"{{name: {name}, rotate: [{{axis: [{_numbers(axis)}], angle_deg: {np.rad2deg(angle):.6g}}}]}}"


def _numbers(vector: Floats) -> str:
    return ", ".join(f"{0.0 + v:.6g}" for v in np.round(vector, 9))
