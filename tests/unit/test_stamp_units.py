"""The unit of stamps that nothing states: by the rate at which readings come, pauses left out."""

import numpy as np
import pytest

from station.domain.recognition import clock
from station.errors import SamplesError

RNG = np.random.default_rng(5)
STEADY = 53 * np.arange(214) + RNG.integers(-2, 3, 214)


@pytest.mark.parametrize(
    "stamps",
    [
        STEADY,
        # The first line is what a buffer still held, a minute old.
        np.r_[74, 59_126 + STEADY],
        # Five pauses while the unit is turned over.
        STEADY + 15_000 * np.searchsorted([40, 80, 120, 160, 200], np.arange(214)),
        # Four readings share each stamp.
        STEADY // 212 * 212,
    ],
)
def test_pauses_do_not_tell_the_unit_of_stamps(stamps: np.ndarray) -> None:
    found = clock.stamped("a.csv", stamps, "column 0", "", None)
    assert (found.unit, found.inferred) == ("ms", True)


def test_stamps_of_one_value_have_no_unit_to_tell() -> None:
    """Refused by what they are, not by a division."""
    with pytest.raises(SamplesError, match="every stamp is the same"):
        clock.stamped("a.csv", np.full(100, 7.0), "t", "", None)
