"""What is measured and what is simulated, in the same few numbers a visit.

A view holds the visits of one table with the simulation at its present best: the units' calibration (`base`) and the
causes that act (`active`). Readings are compared after the unit's own matrix is taken off, so that a turned part
looks the same in every unit. Where the pose is unknown (`reference.pose: unknown`) the direction of the stimulus at
each visit is estimated from the reading itself; of the three numbers of a visit then only the one along the stimulus
is data, which is the magnitude.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from station.diagnosis.data import magnitudes
from station.diagnosis.data.contrast_noise import ContrastNoise
from station.diagnosis.data.reduce import ReducedScene
from station.diagnosis.data.visit_noise import MAD_PER_SIGMA
from station.diagnosis.linear.grid import RowLayout, VisitGrid, visit_grid
from station.diagnosis.linear.projection import DataColumns
from station.domain.core.types import Array, Floats
from station.model.effect import Effect
from station.model.effects.offset_temperature import OffsetTemperature
from station.model.forward import (
    NO_EFFECTS,
    ActiveEffect,
    ActiveEffects,
    BaseResponse,
    derivatives,
    forward,
    resting_stimulus,
    sensor_reading,
    sensor_signal,
)
from station.model.likely_courses import TemperatureCourse
from station.model.scene import Scene, Signal, runs_of_temperature
from station.model.temperature_course import likely_courses

#: Noise of a visit's mean beside that of its samples over √n, or of its quietest contrast, at the least: blue noise
#: averages better than white.
MIN_NOISE_RATIO = 0.5
#: Nothing measures its stimulus to a smaller share; readings that do were computed.
LEAST_NOISE_SHARE = 1e-7
#: What goes on within a dwell as it does from one to the next: a long dwell shows it, too.
COURSES = frozenset({"time", "since-power", "since-clamp", "temperature", "temperature-input"})
#: Visits whose blocks are looked into together: with sixteen numbers a column each, a megabyte.
VISITS_AT_ONCE = 2048
#: Courses of the temperature, of those that are likely, that sizes are looked at with.
MOST_COURSES = 8
#: Of what an axis feels, as a share of the most, so many digits are the recipe's.
STIMULUS_DIGITS = 6
#: An axis whose stimulus varies by less than this share of its strength (rms over a unit's visits) shows no gain.
MIN_GAIN_STIMULUS = 1e-3


@dataclass(frozen=True, eq=False)
class ResidualView:
    """reduced visits, their grid, the simulation (base, active), own (v, k, 3) from readings to each axis' own numbers,
    sigma: sd of a single sample within the visits, contrast_noise that of each contrast beside it, and apart (k, k),
    which makes of the visits' means whose noise the axes share such as share none."""

    reduced: ReducedScene
    grid: VisitGrid
    base: BaseResponse
    active: ActiveEffects
    own: Floats
    sigma: float
    contrast_noise: ContrastNoise
    apart: Floats

    @property
    def scene(self) -> Scene:
        """One row a visit."""
        return self.reduced.scene

    @cached_property
    def signal(self) -> Signal:
        """What the sensors feel at the visits; every signature begins with it."""
        return sensor_signal(self.scene, self.active)

    @property
    def stimulus(self) -> Floats:
        """What each sensor feels at rest at each visit (v, 3)."""
        return self.signal.at_visit

    @cached_property
    def nominal_stimulus(self) -> Floats:
        """The same by the recipe alone (v, 3), without the last digits of its poses: what a form makes of those, or of
        the small turns of a cause, is none of its directions, however large its coefficient."""
        a = resting_stimulus(self.scene)
        strength = float(np.max(np.linalg.norm(a, axis=1), initial=1e-300))
        return np.round(a / strength, STIMULUS_DIGITS) * strength

    @cached_property
    def _fine_signal(self) -> Signal:
        """The same inside the blocks."""
        return sensor_signal(self.reduced.fine, self.active)

    @property
    def keep(self) -> Floats:
        """From readings to the numbers kept (v, k, 3)."""
        return self.own if self.keeps_axes else np.asarray(self.apart @ self.own)

    @property
    def keeps_axes(self) -> bool:
        """Whether each number kept is one of an axis."""
        return np.array_equal(self.apart, np.eye(len(self.apart)))

    @property
    def min_variance(self) -> float:
        """The least variance of the white noise of a visit's mean: a few visits may be fitted as closely as one
        likes."""
        longest = float(np.mean(np.sum(self.keep**2, axis=2)))
        quietest = float(np.min(self.contrast_noise.noise, initial=1.0))
        told = (MIN_NOISE_RATIO * self.reduced.sigma * quietest) ** 2 / float(self.reduced.count.sum(1).mean())
        return longest * max(told, (LEAST_NOISE_SHARE * float(np.abs(self.reduced.mean).max())) ** 2)

    @property
    def moves_in_dwell(self) -> bool:
        """Whether a cause at work changes within a visit, so that its means are those of its blocks."""
        return any(_varies_in_dwell(acting.effect) for acting in self.active.values())

    def simulated(self) -> tuple[Floats, Floats]:
        """Means (v, 3) and contrasts (v, B−1, 3) as the simulation has them."""
        if self.moves_in_dwell:
            return self.reduced.reduce_fine(forward(self.reduced.fine, self.base, self.active))
        mean, contrast = sensor_reading(self.signal, self.base, self.active), np.zeros_like(self.reduced.contrast)
        if any(acting.effect.drawn_over in COURSES for acting in self.active.values()):
            contrast = self.reduced.reduce_fine(forward(self.reduced.fine, self.base, self.active))[1]
        return mean, contrast

    def simulates_nearly(self, other: "ResidualView", share: float) -> bool:
        """Whether two views of the same visits simulate the same readings, to a share of the stimulus."""
        if self is other:
            return True
        if self.reduced is not other.reduced:
            return False
        strength = float(np.max(np.linalg.norm(resting_stimulus(self.scene), axis=1), initial=0.0))
        pairs = zip(self.simulated(), other.simulated(), strict=True)
        return all(float(np.max(np.abs(a - b), initial=0.0)) <= share * strength for a, b in pairs)

    def readings(self) -> DataColumns:
        """Measured − simulated, one column; contrasts in units of their noise."""
        mean, contrast = self.simulated()
        return self.rows((self.reduced.mean - mean)[..., None], (self.reduced.contrast - contrast)[..., None])

    @property
    def layout(self) -> RowLayout:
        """How numbers of the visits become rows."""
        apart = None if self.grid.k == 1 else self.reduced.axes_apart
        apart = None if apart is None or np.array_equal(apart, np.eye(3)) else apart
        sigma, blocks_apart = self.sigma * self.contrast_noise.noise, self.contrast_noise.apart
        return RowLayout(self.grid, self.keep, sigma, self.scene.visits.unit.code, apart, blocks_apart)

    def rows(self, visit: Floats, dwell: Floats | None) -> DataColumns:
        """Columns of readings (v, 3, c) and contrasts (v, B−1, 3, c) laid out by unit."""
        return self.layout.rows(visit, dwell)

    def of_units(self, chosen: Array) -> "ResidualView":
        """The view of some units (in order) in which no cause acts; noise is that of all."""
        assert not self.active
        there = np.isin(self.scene.visits.unit.code, chosen)
        reduced, base = self.reduced.of_runs(there), BaseResponse(self.base.offset[chosen], self.base.matrix[chosen])
        grid = visit_grid(reduced.scene.visits, self.grid.k)
        return replace(self, reduced=reduced, grid=grid, base=base, own=self.own[there])

    def signature(self, effect: Effect, of: str = "") -> tuple[Floats, Floats | None]:
        """Derivatives by each axis' coefficient: of the visits' means (v, 3, axes) and of their contrasts
        (v, B−1, 3, axes), None where the cause stands still during a visit."""
        r, at = self.reduced, (self.base, effect, of, self.active)
        if not _varies_in_dwell(effect):
            return np.stack(list(derivatives(r.scene, *at, self.signal)), axis=-1), None
        visits, rows = len(r.mean), r.rows_of_visit
        mean, contrast = np.empty((visits, 3, len(effect.columns))), np.empty((*r.contrast.shape, len(effect.columns)))
        # Some visits at a time: a derivative inside the blocks has sixteen times as many numbers as what is kept of it.
        for first in range(0, visits, VISITS_AT_ONCE):
            some = slice(first, min(first + VISITS_AT_ONCE, visits))
            inside = self._fine_signal.of_rows(slice(some.start * rows, some.stop * rows))
            for i, d in enumerate(derivatives(inside.scene, *at, inside)):
                mean[some, :, i], contrast[some, ..., i] = r.reduce_fine(d, some)
        return mean, contrast

    def by_covariate_error(self, effect: Effect) -> "list[ResidualView]":
        """The view with each mode of the error of an effect's covariate in that one's place, for a standard normal
        number a run; none where it is as good as exact. Of bends in the temperature the range is large, and the error
        nothing beside it; what changes a gain is no course of time, which could be taken for it."""
        reduced = self.reduced
        if "temperature_rate" in effect.needs and reduced.rate_error is not None:
            return [self.with_course(rate=mode) for mode in reduced.rate_error.T]
        if isinstance(effect, OffsetTemperature) and effect.degree == 1 and reduced.degC_error is not None:
            return [self.with_course(degC=effect.about_degC + mode) for mode in reduced.degC_error.T]
        return []

    def covariate_error(self, acting: ActiveEffect) -> Floats | None:
        """How a cause at work may be off because its covariate is (v, 3, modes): each mode times a standard normal
        number a run. None where the covariate is as good as exact."""
        errors = self.by_covariate_error(acting.effect)
        if not errors or not acting.coefficients.any():
            return None

        def acts(scene: Scene) -> Floats:
            return forward(scene, self.base, {acting.effect.id: acting})

        without = forward(self.scene, self.base, NO_EFFECTS)
        return np.stack([acts(view.scene) - without for view in errors], axis=-1)

    def with_course(
        self, *, degC: Floats | None = None, rate: Floats | None = None, errors: "tuple[Floats, Floats] | None" = None
    ) -> "ResidualView":
        """The view of visits that are as warm (v), degC, or warm as fast (v), degC/s, and where these may be off by
        modes (v, modes) of the one and of the other."""
        scene, reduced = self.scene, self.reduced
        scene = scene if degC is None else replace(scene, temperature_degC=degC)
        scene = scene if rate is None else replace(scene, temperature_rate=rate)
        if errors is not None:
            reduced = replace(reduced, degC_error=errors[0], rate_error=errors[1])
        return replace(self, reduced=replace(reduced, scene=scene))

    def by_likely_courses(self) -> "list[tuple[float, ResidualView]]":
        """Probabilities of likely courses of the temperature, of many of some, and the view with each."""
        read = self.reduced.read_degC
        if read is None:
            return [(1.0, self)]
        runs = runs_of_temperature(self.scene, self.scene.time_s, read, self.scene.since_power_s)
        share, likely = zip(*likely_courses(*runs), strict=True)
        chosen, weight = np.arange(len(share)), np.array(share)
        if len(share) > MOST_COURSES:
            # As many in each part of the probability: those of the middles.
            middles = (np.arange(MOST_COURSES) + 0.5) / MOST_COURSES
            chosen, count = np.unique(np.searchsorted(np.cumsum(weight), middles), return_counts=True)
            weight = count / MOST_COURSES
        parts = (TemperatureCourse(*(np.concatenate(each) for each in zip(*likely[i], strict=True))) for i in chosen)
        return [
            (float(w), self.with_course(degC=c.value, rate=c.slope, errors=(c.value_modes, c.modes)))
            for w, c in zip(weight, parts, strict=True)
        ]

    def stimulated(self) -> Floats:
        """Which axes of each visit's unit (v, 3) feel a stimulus that varies, 1 or 0: only those have a gain to fit.

        An axis that always feels the same cannot tell gain from offset, and one that feels only the rounding of its
        pose would turn a thousandth of noise into any gain. Both keep their nominal gain.
        """
        if self.grid.k == 1:
            return np.ones((len(self.reduced.mean), 3))
        a, unit = resting_stimulus(self.scene), self.scene.visits.unit.code
        count = np.maximum(np.bincount(unit), 1)[:, None]
        middle = np.stack([np.bincount(unit, x) for x in a.T], axis=1) / count
        spread = np.stack([np.bincount(unit, x) for x in ((a - middle[unit]) ** 2).T], axis=1) / count
        strength = float(np.max(np.linalg.norm(a, axis=1), initial=1e-300))
        return np.asarray(np.sqrt(spread) > MIN_GAIN_STIMULUS * strength, float)[unit]

    @property
    def feels_one_stimulus(self) -> bool:
        """Whether no axis of any unit has a gain to fit: what acts by the input is then an offset."""
        return not self.stimulated().any()

    def calibration(self, matrix: bool) -> Floats:
        """Signature (v, 3, p) of each unit's offset and gain, or offset and whole matrix; zero for a gain that these
        visits cannot show."""
        a = self.stimulus * self.stimulated()
        offset = np.broadcast_to(np.eye(3), (len(a), 3, 3))
        if not matrix:
            return np.concatenate([offset, np.eye(3) * a[:, None, :]], axis=2)
        gains = np.einsum("ij,vk->vijk", np.eye(3), a)
        if self.grid.k == 1:
            # A length does not tell how the sensor is turned: only the symmetric part of the matrix is anybody's.
            gains = (gains + gains.swapaxes(2, 3)) / 2
        return np.concatenate([offset, gains.reshape(len(a), 3, 9)], axis=2)


def _varies_in_dwell(effect: Effect) -> bool:
    """Whether the cause changes within a visit."""
    return "since_arrival_s" in effect.needs


def initial_view(reduced: ReducedScene, matrix: bool = False) -> ResidualView:
    """The view before anything is known but the calibration, fitted by plain least squares."""
    scene = reduced.scene
    known, units = scene.recipe.pose_known, len(scene.visits.unit.names)
    base = BaseResponse.ideal(units)
    if not known:
        strength = float(np.linalg.norm(scene.visits.stimulus[0]))
        base = magnitudes.initial_base(reduced.mean, scene.visits.unit.code, units, strength)
    own = np.zeros((len(reduced.mean), 3 if known else 1, 3))
    noise = reduced.contrast_noise if known else reduced.contrast_noise.of_lengths()
    apart = reduced.axes_apart if known else np.ones((1, 1))
    grid = visit_grid(scene.visits, own.shape[1])
    view = with_calibration(ResidualView(reduced, grid, base, NO_EFFECTS, own, 1.0, noise, apart), base)
    for _ in range(1 if known else 10):
        view = with_fitted_calibration(view, matrix)
    return with_contrast_noise(view)


def with_contrast_noise(view: ResidualView) -> ResidualView:
    """The view with the noise of a contrast as it now is: that from one sample to the next, or more where slower
    noise adds to the quietest contrast."""
    axes = replace(view, sigma=1.0).layout
    contrast = np.moveaxis(axes.scaled((view.reduced.contrast - view.simulated()[1])[..., None])[..., 0], 1, 0)
    there = [np.abs(c[c != 0]) for c in contrast]
    slow = min((float(np.median(c)) / MAD_PER_SIGMA for c in there if c.size), default=0.0)
    return replace(view, sigma=max(view.reduced.sigma, slow) or 1.0)


def with_fitted_calibration(view: ResidualView, matrix: bool) -> ResidualView:
    """The same with the calibration of each unit that fits its readings best, by least squares."""
    unit = view.scene.visits.unit.code
    columns = np.einsum("vki,vip->vkp", view.keep, view.calibration(matrix))
    residual = np.einsum("vki,vi->vk", view.keep, view.reduced.mean - view.simulated()[0])
    found = np.zeros((len(view.base.offset), columns.shape[2]))
    ends = np.searchsorted(unit, np.arange(len(found) + 1))
    for u in range(len(found)):
        rows = slice(ends[u], ends[u + 1])
        A = columns[rows].reshape(-1, columns.shape[2])
        found[u] = np.linalg.lstsq(A, residual[rows].ravel(), rcond=1e-9)[0]
    return with_calibration(view, changed_base(view.base, found))


def changed_base(base: BaseResponse, change: Floats) -> BaseResponse:
    """A calibration changed by (U, p) of `View.calibration`."""
    matrix = change[:, 3:].reshape(-1, 3, 3) if change.shape[1] == 12 else np.eye(3) * change[:, 3:, None]
    return BaseResponse(base.offset + change[:, :3], base.matrix + matrix)


def with_calibration(view: ResidualView, base: BaseResponse) -> ResidualView:
    """The view with another calibration, its own matrix taken off, and directions to go with it where unknown."""
    inverse = np.asarray(np.linalg.inv(base.matrix)[view.scene.visits.unit.code], float)
    view = replace(view, base=base)
    if view.grid.k == 3:
        return replace(view, own=inverse)
    view, along = _with_directions(view)
    return replace(view, own=np.einsum("vi,vij->vj", along, inverse)[:, None, :])


def _with_directions(view: ResidualView) -> tuple[ResidualView, Floats]:
    """The view of parts turned as their readings say, and what each of them feels then (v, 3)."""
    moving, reduced = view.moves_in_dwell, view.reduced
    for rounds in range(20):
        mean = view.simulated()[0] if moving else sensor_reading(view.signal, view.base, view.active)
        along, step = magnitudes.next_direction(view.signal, reduced.mean - mean, view.base)
        reduced = replace(reduced, scene=magnitudes.with_directions(view.scene, along))
        if moving:
            reduced = replace(reduced, fine=magnitudes.with_directions(reduced.fine, along))
        view = replace(view, reduced=reduced)
        # Before the first round nobody knows any direction, so that it has nothing to be still against.
        if rounds and step < magnitudes.CONVERGED_RAD:
            break
    fine = magnitudes.with_directions(reduced.fine, along)
    return replace(view, reduced=replace(reduced, fine=fine)), along
