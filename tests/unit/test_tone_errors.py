"""Intervals of a tone's numbers, and the copies of its line that equal steps from dwell to dwell make."""

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.diagnosis.data.faults import motor_tone
from station.diagnosis.data.faults.gross_fault import FaultParameter
from station.domain.core.types import Labels, SampleTable

RATE_HZ, VISITS, SAMPLES, STEP_S = 50.0, 48, 30, 3.7
TONE_HZ, AMPLITUDE, SIGMA = 17.31, np.array([0.3, -0.8, 0.5]), 1e-3
DRAWS = 10


def sampled(rng: np.random.Generator, phi: float) -> SampleTable:
    """Dwells in equal steps in two runs, with a tone in proportion to the drive in noise of first order phi."""
    late = np.arange(SAMPLES) / RATE_HZ
    at = (STEP_S * np.arange(VISITS) + 211.3 * (np.arange(VISITS) >= VISITS / 2))[:, None] + late
    drive = rng.uniform(0, 1, VISITS)
    noise = rng.standard_normal((VISITS, SAMPLES, 3))
    for i in range(1, SAMPLES):
        noise[:, i] = phi * noise[:, i - 1] + np.sqrt(1 - phi**2) * noise[:, i]
    tone = drive[:, None] * np.sin(2 * np.pi * TONE_HZ * at + 1.0)
    reading = SIGMA * (noise + tone[..., None] * AMPLITUDE)
    visit = np.repeat(np.arange(VISITS, dtype=np.int32), SAMPLES)
    return SampleTable(
        unit=Labels(("U0",), np.zeros(len(visit), np.int32)),
        run=(visit >= VISITS / 2).astype(np.int32),
        visit=visit,
        position=Labels(("z-up",), np.zeros(len(visit), np.int32)),
        time_s=at.ravel(),
        reading=reading.reshape(-1, 3),
        values={"motor": np.repeat(drive, SAMPLES), "started_s": np.zeros(len(visit))},
    )


def numbers(phi: float, draw: int) -> tuple[FaultParameter, ...]:
    recipe = load_recipe("six-point")
    recipe = recipe.model_copy(update={"device": recipe.device.model_copy(update={"rate_hz": RATE_HZ})})
    made = sampled(np.random.default_rng([draw, int(10 * phi)]), phi)
    (fault,) = motor_tone.faults(recipe, made, made.visit.astype(np.intp))
    return fault.numbers


@pytest.mark.parametrize("phi", [0.0, 0.6])
def test_intervals_of_a_tone_hold_its_numbers_in_noise_of_any_colour(phi: float) -> None:
    off: dict[str, list[float]] = {"amplitude": [], "frequency": []}
    for draw in range(DRAWS):
        found = numbers(phi, draw)
        told = [n for n in found if n.name == "amplitude"]
        sign = np.sign(np.dot([float(n.value) for n in told], AMPLITUDE))
        for n, true in zip(told, sign * SIGMA * AMPLITUDE, strict=True):
            off["amplitude"].append((float(n.value) - true) / float(n.std or 0))
        (hz,) = (n for n in found if n.name == "frequency")
        off["frequency"].append((float(hz.value) - TONE_HZ) / float(hz.std or 0))
    for z in map(np.array, off.values()):
        # Four deviations of so many that miss, and of their mean square.
        assert np.mean(np.abs(z) > 1.96) < 0.05 + 4 * np.sqrt(0.05 * 0.95 / len(z))
        assert np.mean(np.minimum(np.abs(z), 10) ** 2) < 1 + 4 * np.sqrt(2 / len(z))
    assert np.mean(np.square(off["amplitude"])) > 1 - 4 * np.sqrt(2 / len(off["amplitude"]))
