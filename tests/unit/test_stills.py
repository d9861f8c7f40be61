"""Rest is found in a recording that nobody has marked."""

import numpy as np
import pytest

from station.domain.capture import rest_segments
from station.domain.core.types import Floats
from station.errors import SamplesError


def recording(rng: np.random.Generator, stops: int, still_s: float, noise: float) -> tuple[Floats, Floats, list[int]]:
    """Time, readings and the middle rows of `stops` rests, with two seconds of turning between them."""
    direction = rng.standard_normal((stops + 1, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    parts, middles, n = [], [], 0
    for i in range(stops):
        rest = np.tile(direction[i], (round(100 * still_s), 1))
        share = np.linspace(0, 1, 200)[:, None]
        turn = direction[i] * (1 - share) + direction[i + 1] * share + 0.2 * rng.standard_normal((200, 3))
        middles.append(n + len(rest) // 2)
        parts += [rest, turn]
        n += len(rest) + len(turn)
    reading = np.concatenate(parts) + noise * rng.standard_normal((n, 3))
    return np.arange(n) / 100, reading, middles


@pytest.mark.parametrize("still_s", [2.0, 8.0])
def test_every_rest_is_found_once_and_nothing_else(rng: np.random.Generator, still_s: float) -> None:
    time_s, reading, middles = recording(rng, 14, still_s, 0.003)
    found = rest_segments.find(time_s, reading)
    assert len(found) == 14
    for (a, b), middle in zip(found, middles, strict=True):
        assert a < middle < b
        assert (b - a) / 100 == pytest.approx(still_s, abs=0.6)
        assert reading[a:b].std(axis=0).max() < 0.0045


def test_time_may_be_in_any_step(rng: np.random.Generator) -> None:
    time_s, reading, _ = recording(rng, 6, 5.0, 0.003)
    slow = slice(None, None, 5)
    assert len(rest_segments.find(time_s[slow], reading[slow])) == 6


def test_readings_that_arrive_in_bursts_rest_as_well(rng: np.random.Generator) -> None:
    """Their usual step is that within a burst, by which a minute was too short to tell."""
    time_s, reading, middles = recording(rng, 6, 5.0, 0.003)
    burst = np.arange(len(time_s)) // 7
    arrived = np.array([time_s[burst == b].max() for b in range(burst.max() + 1)])[burst]
    found = rest_segments.find(arrived + 3e-4 * (np.arange(len(time_s)) % 7), reading)
    assert len(found) == len(middles)


def test_a_table_has_a_visit_for_each_stretch(rng: np.random.Generator) -> None:
    time_s, reading, _ = recording(rng, 4, 3.0, 0.003)
    found = rest_segments.find(time_s, reading)
    table = rest_segments.table(time_s, reading, found, "SN1", ["a", "b", "a", "c"])
    assert table.position.names == ("a", "b", "c")
    assert np.unique(table.visit).tolist() == [0, 1, 2, 3]
    assert len(table) == (found[:, 1] - found[:, 0]).sum()


def test_directions_that_are_alike_are_one_orientation() -> None:
    five = np.deg2rad(5.0)
    x = np.array([[1, 0, 0], [np.cos(five), np.sin(five), 0], [0, 1, 0], [0, 0, -2.0]])
    assert rest_segments.orientations(x).tolist() == [0, 0, 1, 2]


def test_a_recording_too_short_to_tell_is_refused() -> None:
    with pytest.raises(SamplesError, match="too short"):
        rest_segments.find(np.arange(100) / 100, np.zeros((100, 3)))


def test_a_sensor_whose_steps_hide_its_noise_rests_between_two_codes(rng: np.random.Generator) -> None:
    """Many windows read one code only, and others at rest go to and fro between two."""
    time_s, reading, _ = recording(rng, 12, 4.0, 0.004)
    assert len(rest_segments.find(time_s, np.round(32 * reading))) == 12
