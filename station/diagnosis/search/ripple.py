"""Ripples faster than the visits follow each other: an aliased line, a floor that sways, a regulator that hunts.

A kernel for each frequency would be hundreds; what the readings leave under the floor is white by itself, so that the
best of many waves is judged by its own distribution: of n free numbers the share R² that K columns explain leaves
1 − R² as Beta((n − K)/2, K/2). A wave may have another phase in each run, in each unit, or one for all; a whole block
of a dwell sees the mean of it. Noise with a colour raises many neighbouring frequencies alike: each is judged beside
the median of those around it.
"""

from collections.abc import Iterator

import numpy as np
import scipy

from station.diagnosis.data.reduce import NODES, mean_and_contrasts
from station.diagnosis.linear.evidence import log_mean_exp
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.unseen import NOTHING, Unseen
from station.domain.core.types import Array, Floats

#: From one frequency to the next, waves in the longest run; the fastest, waves in a dwell; the most that are tried.
STEP, FASTEST, MOST_TRIED = 0.6, 1.5, 600
#: Units of which they are looked for, and visits of the longest run: beyond, noise has other colours than white.
MOST_UNITS, MOST_VISITS = 24, 120
#: Frequencies tried at once, and those whose median is the noise around one.
AT_ONCE, AROUND = 64, 41
#: Sizes of a wave's variance beside the noise over which its evidence is averaged.
RATIOS = np.geomspace(0.03, 300.0, 20)


def find_ripple(problem: ScoringProblem, floor: NoiseFloor) -> Unseen:
    """What ripples explain of the readings under a floor; nothing of few, of very long runs, or of lengths alone."""
    cycles_hz = _frequencies_hz(problem)
    if not len(cycles_hz):
        return NOTHING
    white, dof, share = _white_blocks(problem, floor)
    levels = _levels(problem, len(white))
    numbers = 6 * np.array([len(starts) for starts in levels], float)
    if dof <= 2 * numbers.max() or not white.any():
        return NOTHING
    found = [_explained(problem, some, white, share, levels) for some in _parts(cycles_hz)]
    explained = np.concatenate(found, axis=1) * dof / float(np.sum(white**2))
    usual = numbers * (1 - 2 / (9 * numbers)) ** 3
    around = _median_around(explained) / usual[:, None]
    explained = np.minimum(explained / np.maximum(around, 1.0), dof * (1 - 1e-9))
    left = 1 - explained / dof
    chance = scipy.special.betainc((dof - numbers[:, None]) / 2, numbers[:, None] / 2, left).min() * left.size
    grown = RATIOS[:, None, None] / (1 + RATIOS[:, None, None])
    each = -0.5 * dof * np.log1p(-grown * explained / dof) - 0.5 * numbers[:, None] * np.log1p(RATIOS)[:, None, None]
    return Unseen.of(float(log_mean_exp(each.ravel())), chance)


def _median_around(explained: Floats) -> Floats:
    """The median of each value (levels, f) and of those on both sides of it."""
    side = AROUND // 2
    padded = np.pad(explained, ((0, 0), (side, side)), mode="edge")
    return np.partition(np.lib.stride_tricks.sliding_window_view(padded, AROUND, axis=1), side, axis=2)[..., side]


def _frequencies_hz(problem: ScoringProblem) -> Floats:
    """Frequencies from a wave in two visits to some waves in a dwell."""
    view, visits = problem.view, problem.view.grid.slot.shape[2]
    t, begun = view.scene.time_s, view.reduced.fine.time_s.reshape(len(view.scene.time_s), -1)
    lasted, dwell = float(np.ptp(t)), float(np.median(np.ptp(begun, axis=1)))
    if view.grid.k != 3 or not 4 <= visits <= MOST_VISITS or lasted <= 0.0 or dwell <= 0.0:
        return np.zeros(0)
    return np.asarray(np.arange(visits / 2, FASTEST * lasted / dwell, STEP)[:MOST_TRIED] / lasted)


def _parts(cycles_hz: Floats) -> Iterator[Floats]:
    yield from np.split(cycles_hz, range(AT_ONCE, len(cycles_hz), AT_ONCE))


def _white_blocks(problem: ScoringProblem, floor: NoiseFloor) -> tuple[Floats, int, float]:
    """What is left of means and contrasts (v, B, 3) of some units in white noise, how many free numbers that is, and
    the noise of a sample beside that of a visit's mean."""
    setting, _ = problem.setting.of_units(np.arange(min(problem.view.grid.units, MOST_UNITS)))
    space = setting.space(floor, moving=problem.view.reduced.contrast.shape[1] > 0)
    slot = setting.layout.grid.slot
    residual, numbers = space.residual, slot[0].size * 3
    visits = residual[:, :numbers].reshape(*slot.shape, 1, 3)
    inside = residual[:, numbers : numbers + space.dwell].reshape(*slot.shape, -1, 3)
    there = slot >= 0
    white = np.concatenate([visits, inside], axis=3)[there][np.argsort(slot[there])]
    return white, space.dof, problem.view.sigma / floor.noise


def _levels(problem: ScoringProblem, most: int) -> list[Array]:
    """Where the first visits of each run, of each unit, and of all begin; levels that are the same but once."""
    visits = problem.view.scene.visits
    runs = np.flatnonzero(visits.previous[:most] < 0)
    units = np.flatnonzero(np.diff(visits.unit.code[:most], prepend=-1))
    return list({len(starts): starts for starts in (runs, units, np.zeros(1, np.intp))}.values())


def _explained(problem: ScoringProblem, cycles_hz: Floats, white: Floats, share: float, levels: list[Array]) -> Floats:
    """Squares (levels, f) that waves of some frequencies explain of white blocks (v, B, 3)."""
    reduced, v = problem.view.reduced, len(white)
    count, fine = reduced.count[:v], reduced.fine.time_s.reshape(*reduced.count.shape, len(NODES))[:v]
    # Of each block, what is looked at: the mean in noises of a sample, and the contrasts.
    B = count.shape[1]
    mean, contrasts = mean_and_contrasts(np.broadcast_to(np.eye(B), (v, B, B)), count)
    root = np.sqrt(count.sum(1))[:, None]
    rows = np.concatenate([(mean * share * root / root.mean())[:, None], contrasts], axis=1)[:, : white.shape[1]]
    # A block lasts √12 times the deviation of its times. Single precision is enough, but to count waves.
    lasts = np.sqrt(12) * (fine[..., -1] - fine[..., 0]) / (NODES[-1] - NODES[0])
    phase = (2 * np.pi * (fine.mean(2)[..., None] * cycles_hz % 1.0)).astype(np.float32)
    size, wave = np.sinc((lasts[..., None] * cycles_hz).astype(np.float32)), np.empty(phase.shape, np.complex64)
    wave.real, wave.imag = size * np.cos(phase), size * np.sin(phase)
    along = wave.swapaxes(1, 2) @ (rows.swapaxes(1, 2) @ white).astype(np.float32)
    shown = (rows.swapaxes(1, 2) @ rows).astype(np.float32) @ wave
    squares, turned = np.sum(np.real(np.conj(wave) * shown), axis=1), np.sum(wave * shown, axis=1)
    found = []
    for starts in levels:
        b, n, m = (np.add.reduceat(x, starts, axis=0) for x in (along, squares, turned))
        # The normal matrix of cosine and sine is ½ [[n + Re m, Im m], [Im m, n − Re m]].
        other = n[..., None] * np.abs(b) ** 2 - np.real(np.conj(m)[..., None] * b**2)
        found.append(np.sum(2 * other / np.maximum(n**2 - np.abs(m) ** 2, 1e-9 * n**2)[..., None], axis=(0, 2)))
    return np.stack(found)
