"""How long to dwell, decided while the dwell goes on: a fixed time, or until the coefficients are good enough."""

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
    """How long dwells last. number: the visit's place in the recipe's plan, None where it is for verification.

    prior: what is known of the units' noise beforehand, for their calibration too.
    """

    prior: NoisePrior | None

    def first_s(self, number: int | None, /) -> float:
        """When to ask for the first time."""

    def until_s(self, number: int | None, lasted_s: float, read: ReadDwell, /) -> float:
        """When to ask again; the dwell is over when that is not later than `lasted_s`."""

    def ended(self, number: int | None, lasted_s: float, read: ReadDwell, /) -> None:
        """The dwell is over."""

    def document(self, serial: str, /) -> Mapping[str, object]:
        """What the record keeps of the dwells of a unit; nothing where they were as long as the recipe says."""


class FixedDwell:
    """Every dwell lasts as long; its readings are not needed for that."""

    prior: NoisePrior | None = None

    def __init__(self, time_s: float) -> None:
        self._time_s = time_s

    def first_s(self, _number: int | None, /) -> float:
        """The fixed time."""
        return self._time_s

    def until_s(self, _number: int | None, _lasted_s: float, _read: ReadDwell, /) -> float:
        """The fixed time."""
        return self._time_s

    def ended(self, _number: int | None, _lasted_s: float, _read: ReadDwell, /) -> None:
        """Nothing is learnt."""

    def document(self, _serial: str, /) -> Mapping[str, object]:
        """Nothing."""
        return {}


class AdaptiveDwell:
    """Dwells as long as the coefficients of the noisiest unit need; visits of verification last as the others did."""

    def __init__(self, recipe: Recipe, earlier: Sequence[NoiseLikelihood] = ()) -> None:
        self.aim = adaptive_dwell.accuracy_target(recipe)
        self._prior_for = adaptive_dwell.prior_length(recipe)
        self.prior = noise_prior.learn_prior(earlier, self._prior_for)
        self._plan_s = adaptive_dwell.dwells_by_sheet_s(recipe)
        self._done_s = np.zeros(len(self.aim))
        self._read: dict[str, dict[int, Floats]] = {}
        self._noise: dict[tuple[str, int], tuple[tuple[int, int], DwellNoise]] = {}

    def first_s(self, number: int | None, /) -> float:
        """The shortest dwell; of a verification the usual one."""
        done = self._done_s[self._done_s > 0]
        return self.aim.shortest_s if number is not None or not len(done) else float(done.mean())

    def until_s(self, number: int | None, lasted_s: float, read: ReadDwell, /) -> float:
        """What the plan says now, or a moment before it at which to look again."""
        if number is None or lasted_s >= self.aim.longest_s:
            return lasted_s
        sufficient = self._store_readings(number, read())
        if not set(sufficient) - {GOLD_KEY}:
            # The visit's check reports a unit that sends too little; it must not hold the others up.
            return min(MIN_READINGS / self.aim.rate_hz, self.aim.longest_s)
        self._done_s[number] = 0.0
        self._plan_s = self._planned(sufficient, self._done_s, lasted_s)
        return float(adaptive_dwell.next_check_s(self._plan_s[[number]], np.array([lasted_s]))[0])

    def ended(self, number: int | None, lasted_s: float, read: ReadDwell, /) -> None:
        """Takes the whole dwell; a visit that is measured again counts as it was the last time."""
        if number is not None:
            self._store_readings(number, read())
            self._done_s[number] = lasted_s

    def document(self, serial: str, /) -> Mapping[str, object]:
        """Dwells (v), s, as they were, and as the unit would have needed them alone, its noise known from the start."""
        if not self._read.get(serial):
            return {}
        gold = (GOLD_KEY,) if GOLD_KEY in self._read else ()
        alone_s = self._planned((serial, *gold), np.zeros_like(self._done_s), 0.0)
        return {
            "dwell_s": self._done_s.tolist(),
            "alone_s": np.round(alone_s, 3).tolist(),
            "noise": noise_document.of_likelihood(self._likelihood(serial)),
            "prior": None if self.prior is None else noise_document.of_prior(self.prior),
        }

    def _store_readings(self, number: int, readings: Readings) -> tuple[str, ...]:
        """Takes what was read in a dwell so far; returns the serials with readings enough to estimate noise."""
        sufficient = tuple(serial for serial, x in readings.items() if len(x) >= MIN_READINGS)
        for serial in sufficient:
            self._read.setdefault(serial, {})[number] = readings[serial]
        return sufficient

    def _planned(self, serials: tuple[str, ...], done_s: Floats, lasted_s: float) -> Floats:
        at = sorted(set.intersection(*(set(self._read[s]) for s in serials)))
        reach = family_length(max(len(x) for read in self._read.values() for x in read.values()), self.prior)
        # The gold reference is of another kind.
        gold = self._curves((GOLD_KEY,), at, reach, None)[0] if GOLD_KEY in serials else None
        units = tuple(serial for serial in serials if serial != GOLD_KEY)
        measured_s = np.array([self._done_s[at].sum() + lasted_s])
        curve_of_all = adaptive_dwell.worst_curve(self._curves(units, at, reach, self.prior), gold)
        so_far = DwellProgress(curve_of_all, done_s[None], np.array(at), measured_s)
        return np.asarray(adaptive_dwell.plan_dwells(self.aim, so_far, self._plan_s[None]).dwell_s[0])

    def _curves(
        self, serials: tuple[str, ...], at: list[int], reach: int, prior: NoisePrior | None
    ) -> list[NoiseCurve]:
        """The noise of each by its visits `at`; learnt together, for one at a time takes as long as all."""
        dwells = [join_units([self._dwell_noise(serial, number, reach) for serial in serials]) for number in at]
        return noise_curve(dwells, reach, prior).apart()

    def _likelihood(self, serial: str) -> NoiseLikelihood:
        """What a unit tells of its kind."""
        (one,) = likelihoods(
            [dwell_noise(x[None], self._prior_for) for x in self._read[serial].values()], self._prior_for
        )
        return one

    def _dwell_noise(self, serial: str, number: int, reach: int) -> DwellNoise:
        reading = self._read[serial][number]
        key, noise = self._noise.get((serial, number), ((0, 0), None))
        if noise is None or key != (len(reading), reach):
            key, noise = (len(reading), reach), dwell_noise(reading[None], reach)
            self._noise[serial, number] = key, noise
        return noise


def control_for(recipe: Recipe, earlier: EarlierDwells) -> DwellControl:
    """The pace that the recipe asks for; earlier: units of the kind, asked for where their noise matters."""
    if recipe.dwell.time_s is not None:
        return FixedDwell(recipe.dwell.time_s)
    return AdaptiveDwell(recipe, noise_document.all_likelihoods(earlier()))
