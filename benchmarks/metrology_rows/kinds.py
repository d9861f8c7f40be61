"""Coverage for magnetometers, gyroscopes and inclinometers: truths by formulas of their own, errors as stated."""

from typing import Any

import numpy as np
from metrology_rows.bench import Bench
from metrology_rows.designs import DEG, FACES, Floats, orientation, quaternion, spun
from metrology_rows.report import Report

from station.domain.recipe.recipe import Recipe

COVERED = (0.94, 0.96)
NEST_DEG, BASE_DEG, FIELD_DEG = 0.1, 0.05, 0.2
FIELD_UT, FIELD_STD_UT = 50.0, 0.05
SPEED, SPEED_STD, PULL = 100.0, 0.01, 0.02
ANGLES = np.array(
    [
        (0, 0),
        (30, 0),
        (-30, 0),
        (60, 0),
        (-60, 0),
        (0, 30),
        (0, -30),
        (0, 60),
        (0, -60),
        (30, 30),
        (-30, -30),
        (40, -20),
    ],
    float,
)


class KindBench(Bench):
    """A bench whose poses are those of its recipe's design."""

    def __init__(self, of: Recipe, poses: Floats, count: int, report: Report, seed: int) -> None:
        self.recipe, self.poses, self.count, self.report, self.seed = of, poses, count, report, seed
        self.rng = report.generator(seed)
        self.accepted_at_limit = 0.0
        self.offset = self.rng.standard_normal((count, 3))
        self.matrix = np.eye(3) + 0.01 * self.rng.standard_normal((count, 3, 3))

    def turned(self, degrees: float) -> Floats:
        """One turn a unit (n, 1, 3, 3)."""
        return spun(DEG * degrees * self.rng.standard_normal((self.count, 1, 3)))

    def noisy(self, true: Floats, noise: float) -> Floats:
        """Readings of those truths (n, v, 3) with white noise."""
        shape = (*true.shape[:2], 60, 3)
        return self.readings(true, noise * self.rng.standard_normal(shape))


def kinds(units: int, report: Report) -> None:
    """Nest, base, field, speed and g-sensitivity off by what is stated."""
    _magnetometer(units, report)
    _gyroscope(units, report)
    _inclinometer(units, report)


def _recipe(sensor: str, unit: str, method: str, **more: Any) -> Recipe:
    names = {"schema": "station.recipe/1", "name": f"{sensor}-{method}", "version": 1, "sensor": sensor, "unit": unit}
    device = {"rounding": "nearest"} | more.pop("device", {})
    return Recipe.model_validate({**names, "method": method, "device": device, **more})


def _places(poses: Floats) -> list[dict[str, Any]]:
    return [{"name": f"p{i:02d}", "quaternion": quaternion(R)} for i, R in enumerate(poses)]


def _magnetometer(units: int, report: Report) -> None:
    poses = np.array([orientation(up) for up in FACES])
    reference = {"source": "field", "vector": [0, 0, FIELD_UT], "magnitude_std": FIELD_STD_UT}
    reference |= {"nest_std_deg": NEST_DEG, "field_std_deg": FIELD_DEG}
    of = _recipe("magnetometer", "uT", "six-point", positions=_places(poses), reference=reference)
    bench = KindBench(of, poses, units, report, 121)
    strength = FIELD_UT + FIELD_STD_UT * bench.rng.standard_normal((units, 1, 1))
    R = bench.turned(FIELD_DEG) @ poses @ bench.turned(NEST_DEG)
    bench.coverage("magnetometer, six faces", bench.noisy(strength * R[:, :, 2], 0.05), COVERED)


def _gyroscope(units: int, report: Report) -> None:
    """Six spins about upright axes at the pole, and one of them alone."""
    spins, poses = SPEED * FACES, np.array([orientation(np.abs(up)) for up in FACES])
    places = [one | {"rate": rate} for one, rate in zip(_places(poses), spins.tolist(), strict=True)]
    site = {"latitude_deg": 90.0, "altitude_m": 0.0, "heading_deg": 0.0}
    reference = {"source": "rate", "magnitude_std": SPEED_STD, "nest_std_deg": NEST_DEG, "site": site}
    earth = 360 / 86164.0905  # deg/s, upright at the pole
    for method, v in (("six-point", 6), ("one-point", 1)):
        sheet = {"g_sensitivity": PULL, "gain_std": 0.01, "cross_std": 0.01}
        of = _recipe("gyroscope", "deg/s", method, positions=places[-v:], reference=reference, device=sheet)
        bench = KindBench(of, poses[-v:], units, report, 122)
        speed = 1 + SPEED_STD / SPEED * bench.rng.standard_normal((units, 1, 1))
        true = np.einsum("nxji,nvj->nvi", bench.turned(NEST_DEG), spins[-v:] * speed)
        pull = PULL * bench.rng.standard_normal((units, 3, 3)) @ np.abs(FACES[-v:]).T
        felt = true + earth * np.abs(FACES[-v:])
        values = bench.noisy(felt, 0.05) + pull.transpose(0, 2, 1)[:, :, None]
        bench.coverage(f"gyroscope, {method}, g-sensitivity", values, COVERED)


def _inclinometer(units: int, report: Report) -> None:
    """Angles between two axes and the horizontal plane, of tilts about both level axes."""
    ups = np.column_stack([np.sin(DEG * ANGLES), np.sqrt(1 - (np.sin(DEG * ANGLES) ** 2).sum(axis=1))])
    poses = np.array([orientation(up) for up in ups])
    reference = {"source": "gravity", "nest_std_deg": NEST_DEG, "base_std_deg": BASE_DEG}
    sheet = {"axes": 2, "convention": "horizon"}
    of = _recipe("inclinometer", "deg", "n-point", positions=_places(poses), reference=reference, device=sheet)
    bench = KindBench(of, poses, units, report, 123)
    bench.matrix[:, 2], bench.matrix[:, :, 2], bench.offset[:, 2] = 0.0, 0.0, 0.0
    R = bench.turned(BASE_DEG) @ poses @ bench.turned(NEST_DEG)
    true = np.arcsin(np.clip(R[:, :, 2], -1, 1)) / DEG
    true[:, :, 2] = 0.0
    values = bench.noisy(true, 0.02)
    values[..., 2] = 0.0
    bench.coverage("inclinometer, twelve tilts", values, COVERED)
