"""Output data rates that sensors are set to: a rate that is exactly one of them is a setting, no error of a clock."""

import numpy as np

#: Rates, Hz, that with their doubles and halves are what data sheets offer.
USUAL_HZ = np.array([75.0, 80.0, 100.0, 102.4, 104.0, 112.5, 119.0, 120.0, 125.0, 128.0])
#: A measured rate is a usual one when it is so near to it, and another than the sheet's when it is so far from that.
SAME, ANOTHER = 5e-4, 0.01


def is_another(rate_hz: float, sheet_hz: float) -> bool:
    """Whether a measured rate is a usual one that the data sheet does not state."""
    if abs(rate_hz / sheet_hz - 1) < ANOTHER:
        return False
    octaves = np.log2(rate_hz / USUAL_HZ)
    return bool(np.min(np.abs(octaves - np.round(octaves))) < SAME / np.log(2))
