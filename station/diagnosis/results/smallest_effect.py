"""The smallest effects that these data would have shown."""

import numpy as np
from scipy.special import chdtri, chndtrinc

from station.diagnosis.linear.evidence import EigenSpectrum
from station.diagnosis.search.scoring import ScoredBank

#: What searching the whole bank costs in amplitude beside a test of one form (docs/diagnosis.md).
SEARCH_PENALTY = 1.2
LEVEL, POWER = 0.01, 0.80


def detectable_length(k: float) -> float:
    """Length d of a signal of k free coefficients that a χ² test of 1 % finds with 80 % chance."""
    return float(np.sqrt(chndtrinc(chdtri(k, LEVEL), k, 1 - POWER)))


def smallest_detectable(now: ScoredBank, share: float) -> dict[str, float]:
    """Rms coefficient of each cause that would be seen, in its own unit; of its easiest shape and level. share: how
    many units each of those looked at stands for."""
    found: dict[str, float] = {}
    for scored in now.projected:
        for candidate, spectrum in zip(scored.bank.candidates, scored.spectra, strict=True):
            if candidate.effect is not None:
                rms = _of(spectrum, share)
                found[candidate.name] = min(rms, found.get(candidate.name, np.inf))
    return {name: rms for name, rms in found.items() if np.isfinite(rms)}


def _of(spectrum: EigenSpectrum, share: float) -> float:
    m = np.atleast_1d(spectrum.m)
    if spectrum.pattern == "scan":
        m = m.reshape(-1, m.shape[-1])
        m, share = m[int(m.sum(1).argmax())], 1.0
    total = share * float(m.sum())
    if total <= 0:
        return float("inf")
    squares = float(np.sum(m**2)) * (share if spectrum.pattern == "own" else share**2)
    directions = total**2 / squares
    return SEARCH_PENALTY * detectable_length(directions) / float(np.sqrt(total))
