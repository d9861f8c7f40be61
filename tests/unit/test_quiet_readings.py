"""Which readings of a slow turn by hand stand for it."""

import numpy as np

from station.domain.recognition.quiet_readings import portion, quietest


def test_where_the_hand_dwells_it_is_read() -> None:
    rng = np.random.default_rng(1)
    angle = np.cumsum(np.where(np.arange(3000) % 100 < 60, 0.02, 0.0))
    gravity = np.stack([np.cos(angle), np.sin(angle), np.zeros(3000)], axis=1)
    shaken = 0.1 * rng.standard_normal((3000, 3)) * (np.arange(3000) % 100 < 60)[:, None]
    chosen = quietest(gravity + shaken + 1e-3 * rng.standard_normal((3000, 3)), 100)
    assert len(chosen) == 30
    assert np.array_equal(chosen // 100, np.arange(30))
    assert np.all(chosen % 100 >= 60)


def test_of_readings_that_are_a_pose_each_all_stay() -> None:
    assert portion(400, 4.0, moving=False) == 1
    assert np.array_equal(quietest(np.eye(3)[np.arange(400) % 3], 1), np.arange(400))
    assert len(quietest(np.zeros((3, 3)), 2)) == 2


def test_a_moving_hand_is_read_once_a_second_while_enough_is_left() -> None:
    assert portion(16_000, 160.0, moving=True) == 100
    assert portion(2000, 20.0, moving=True) == 40
    assert portion(1_000_000, 10_000.0, moving=True) == 2000
    assert portion(16_000, 160.0, moving=False) == 32
