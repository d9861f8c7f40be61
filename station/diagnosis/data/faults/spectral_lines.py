"""Lines that stand out of the noise of a spectrum, whatever its colour."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.domain.core.medians import medians
from station.domain.core.types import Floats

#: Frequencies tried for each 1/dwell.
OVERSAMPLING = 2
#: The spectrum around a line: so many frequencies on each side, less those that the line itself reaches.
BACKGROUND_BINS, LINE_BINS = 12, 2
#: Cosines that make the colour of the noise, and rounds in which they are fitted.
COLOUR_WAVES, COLOUR_ROUNDS = 4, 12


class PowerSpectrum(NamedTuple):
    """power (f, 3): mean of the visits, each weighted as a tone in proportion to motor would show in it; visits: how
    many count, by their weight."""

    power: Floats
    visits: float


def line_gains(spectrum: PowerSpectrum) -> Floats:
    """Log-likelihood (f) that a line of powers (f, 3) gains over the median of the spectrum around it.

    The background is the data's own, once the noise's colour is off: at the end of a spectrum that falls, what is
    around a line lies on one side of it, and lower. Neither tails nor colour can thus pass for a line. Powers
    are exponential: a mean of N of them that is r times what it should be is e^(−N(r − 1 − ln r)) likely (Chernoff's
    bound). N counts the visits by their weight, and less where the background itself is known from few frequencies.
    """
    known = spectrum.visits / (1 + np.pi / 2 * OVERSAMPLING / np.maximum(_around(len(spectrum.power)).sum(1), 1))
    ratio = np.maximum(spectrum.power / np.maximum(background(spectrum.power), 1e-300), 1.0)
    return np.asarray(known * np.sum(ratio - 1 - np.log(ratio), axis=1))


def background(power: Floats) -> Floats:
    """The power (f, 3) around each frequency, without what may be a line there; infinite where there is none."""
    colour = _colour(power)
    return np.asarray(colour * _medians(power / colour, _around(len(power))))


def _around(frequencies: int) -> NDArray[np.bool_]:
    """Which frequencies (f, f) are the spectrum around each."""
    place = np.arange(frequencies)
    far = np.abs(place[:, None] - place)
    return np.asarray((far > LINE_BINS) & (far <= BACKGROUND_BINS))


def _colour(power: Floats) -> Floats:
    """The noise's smooth spectrum (f, 3): a few cosines of the logarithm (Bloomfield, Biometrika 60 (1973) 217) by
    least absolute deviations, which a line does not bend."""
    log = np.log(np.maximum(power, 1e-300))
    waves = np.cos(np.pi * np.linspace(0.0, 1.0, len(power))[:, None] * np.arange(COLOUR_WAVES))
    found = np.zeros_like(log)
    for axis in range(log.shape[1]):
        weight = np.ones(len(log))
        for _ in range(COLOUR_ROUNDS):
            root = np.sqrt(weight)
            c = np.linalg.lstsq(waves * root[:, None], log[:, axis] * root, rcond=None)[0]
            found[:, axis] = waves @ c
            weight = 1 / np.maximum(np.abs(log[:, axis] - found[:, axis]), 1e-3)
    return np.asarray(np.exp(found - found.mean(0)))


def _medians(values: Floats, near: NDArray[np.bool_]) -> Floats:
    """Medians (n, 3) of those of the values (m, 3) that are near each place (n, m); infinite where none is. Places with
    as many neighbours are gone through together."""
    count = near.sum(1)
    found = np.full((len(near), values.shape[1]), np.inf)
    for many in np.unique(count[count > 0]):
        places = np.flatnonzero(count == many)
        found[places] = medians(values.T[:, np.nonzero(near[places])[1].reshape(-1, many)]).T
    return found
