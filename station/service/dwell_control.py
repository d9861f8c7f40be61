"""How long to stay at a stop, asked while it goes on: a fixed time, or until the coefficients are good enough."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from station.domain.core.types import Floats
from station.domain.noise import noise_document, noise_prior
from station.domain.noise.noise_prior import NoiseLikelihood, NoisePrior
from station.domain.noise.running_noise import (
    MIN_READINGS,
    DwellNoise,
    NoiseCurve,
    dwell_noise,
    family_length,
    join_units,
    likelihoods,
    noise_curve,
)
from station.domain.planning import adaptive_dwell
from station.domain.planning.adaptive_dwell import DwellProgress
from station.domain.recipe.recipe import Recipe

#: Under this serial stand the gold reference's readings, whose noise comes on top of every unit's.
GOLD_KEY = ""
#: Readings (n, 3) of the dwell so far by serial, and how to have them decoded.
Readings = Mapping[str, Floats]
ReadDwell = Callable[[], Readings]
#: Results `dwell` of units measured before, oldest first.
EarlierDwells = Callable[[], Sequence[Mapping[str, Any]]]


class DwellControl(Protocol):
    """How long stops last. A stop is its place in the recipe's plan, None where it is measured for verification.

    prior: what is known of the units' noise beforehand, for their calibration too.
    """

    prior: NoisePrior | None

    def first_s(self, stop: int | None, /) -> float:
        """When to ask for the first time."""

    def until_s(self, stop: int | None, lasted_s: float, read: ReadDwell, /) -> float:
        """When to ask again; the stop is over when that is not later than `lasted_s`."""

    def ended(self, stop: int | None, lasted_s: float, read: ReadDwell, /) -> None:
        """The stop is over."""

    def told(self, serial: str, /) -> Mapping[str, object]:
        """What the record keeps of the dwells of a unit; nothing where they were as long as the recipe says."""


class FixedDwell:
    """Every stop lasts as long; nothing is decoded for it."""

    prior: NoisePrior | None = None

    def __init__(self, time_s: float) -> None:
        self._time_s = time_s

    def first_s(self, _stop: int | None, /) -> float:
        """The fixed time."""
        return self._time_s

    def until_s(self, _stop: int | None, _lasted_s: float, _read: ReadDwell, /) -> float:
        """The fixed time."""
        return self._time_s

    def ended(self, _stop: int | None, _lasted_s: float, _read: ReadDwell, /) -> None:
        """Nothing is learnt."""

    def told(self, _serial: str, /) -> Mapping[str, object]:
        """Nothing."""
        return {}


class AdaptiveDwell:
    """Stops as long as the coefficients of the noisiest unit need; stops of verification last as the others did."""

    def __init__(self, recipe: Recipe, earlier: Sequence[NoiseLikelihood] = ()) -> None:
        self.aim = adaptive_dwell.accuracy_target(recipe)
        self._prior_for = adaptive_dwell.prior_length(recipe)
        self.prior = noise_prior.learn_prior(earlier, self._prior_for)
        self._plan_s = adaptive_dwell.dwells_by_sheet_s(recipe)
        self._done_s = np.zeros(len(self.aim))
        self._read: dict[str, dict[int, Floats]] = {}
        self._told: dict[tuple[str, int], tuple[tuple[int, int], DwellNoise]] = {}

    def first_s(self, stop: int | None, /) -> float:
        """The shortest dwell; of a verification the usual one."""
        done = self._done_s[self._done_s > 0]
        return self.aim.shortest_s if stop is not None or not len(done) else float(done.mean())

    def until_s(self, stop: int | None, lasted_s: float, read: ReadDwell, /) -> float:
        """What the plan says now, or a moment before it at which to look again."""
        if stop is None or lasted_s >= self.aim.longest_s:
            return lasted_s
        telling = self._keep(stop, read())
        if not set(telling) - {GOLD_KEY}:
            # Of a unit that says too little the stop's own check will tell; it must not hold the others up.
            return min(MIN_READINGS / self.aim.rate_hz, self.aim.longest_s)
        self._done_s[stop] = 0.0
        self._plan_s = self._planned(telling, self._done_s, lasted_s)
        return float(adaptive_dwell.next_check_s(self._plan_s[[stop]], np.array([lasted_s]))[0])

    def ended(self, stop: int | None, lasted_s: float, read: ReadDwell, /) -> None:
        """Keeps what the whole dwell told; a stop that is measured again counts as it was the last time."""
        if stop is not None:
            self._keep(stop, read())
            self._done_s[stop] = lasted_s

    def told(self, serial: str, /) -> Mapping[str, object]:
        """Dwells (v), s, as they were, and as the unit would have needed them alone, its noise known from the start."""
        if not self._read.get(serial):
            return {}
        gold = (GOLD_KEY,) if GOLD_KEY in self._read else ()
        alone_s = self._planned((serial, *gold), np.zeros_like(self._done_s), 0.0)
        return {
            "dwell_s": self._done_s.tolist(),
            "alone_s": np.round(alone_s, 3).tolist(),
            "noise": noise_document.of_likelihood(self._seen(serial)),
            "prior": None if self.prior is None else noise_document.of_prior(self.prior),
        }

    def _keep(self, stop: int, readings: Readings) -> tuple[str, ...]:
        """Keeps what was read at a stop so far; returns who said enough to be told by."""
        telling = tuple(serial for serial, x in readings.items() if len(x) >= MIN_READINGS)
        for serial in telling:
            self._read.setdefault(serial, {})[stop] = readings[serial]
        return telling

    def _planned(self, serials: tuple[str, ...], done_s: Floats, lasted_s: float) -> Floats:
        at = sorted(set.intersection(*(set(self._read[s]) for s in serials)))
        reach = family_length(max(len(x) for read in self._read.values() for x in read.values()), self.prior)
        # The gold reference is of another kind.
        gold = self._curves((GOLD_KEY,), at, reach, None)[0] if GOLD_KEY in serials else None
        units = tuple(serial for serial in serials if serial != GOLD_KEY)
        seen_s = np.array([self._done_s[at].sum() + lasted_s])
        curve_of_all = adaptive_dwell.worst_curve(self._curves(units, at, reach, self.prior), gold)
        so_far = DwellProgress(curve_of_all, done_s[None], np.array(at), seen_s)
        return np.asarray(adaptive_dwell.plan_dwells(self.aim, so_far, self._plan_s[None]).dwell_s[0])

    def _curves(
        self, serials: tuple[str, ...], at: list[int], reach: int, prior: NoisePrior | None
    ) -> list[NoiseCurve]:
        """The noise of each by its stops `at`; learnt together, for one at a time takes as long as all."""
        told = [join_units([self._dwelt(serial, stop, reach) for serial in serials]) for stop in at]
        return noise_curve(told, reach, prior).apart()

    def _seen(self, serial: str) -> NoiseLikelihood:
        """What a unit tells of its kind."""
        (one,) = likelihoods(
            [dwell_noise(x[None], self._prior_for) for x in self._read[serial].values()], self._prior_for
        )
        return one

    def _dwelt(self, serial: str, stop: int, reach: int) -> DwellNoise:
        reading = self._read[serial][stop]
        key, told = self._told.get((serial, stop), ((0, 0), None))
        if told is None or key != (len(reading), reach):
            key, told = (len(reading), reach), dwell_noise(reading[None], reach)
            self._told[serial, stop] = key, told
        return told


def control_for(recipe: Recipe, earlier: EarlierDwells) -> DwellControl:
    """The pace that the recipe asks for; earlier: units of the kind, asked for where their noise matters."""
    if recipe.dwell.time_s is not None:
        return FixedDwell(recipe.dwell.time_s)
    return AdaptiveDwell(recipe, noise_document.all_likelihoods(earlier()))
