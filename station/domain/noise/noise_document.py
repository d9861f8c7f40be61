"""What a unit has told of its noise, and what was known of it before, as the log keeps them in the result `dwell`."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from station.domain.noise.noise_prior import NoiseLikelihood, NoisePrior, general_log_weights
from station.errors import LogError

#: A shape this much less likely (in its logarithm) than the likeliest says nothing of the unit.
MIN_LOG_LIKELIHOOD = -12.0


def of_likelihood(likelihood: NoiseLikelihood) -> dict[str, Any]:
    """The shapes that say something of a unit, by number in their family of so many, and what they say, rounded."""
    shapes = np.flatnonzero((likelihood.log_likelihood > MIN_LOG_LIKELIHOOD).any(axis=0))
    return {
        "longest": likelihood.longest,
        "dof": likelihood.dof,
        "family": likelihood.log_likelihood.shape[1],
        "shapes": shapes.tolist(),
        "log_likelihood": likelihood.log_likelihood[:, shapes].round(2).tolist(),
        "log_variance": likelihood.log_variance[:, shapes].round(4).tolist(),
    }


def all_likelihoods(dwells: Iterable[Mapping[str, Any]]) -> list[NoiseLikelihood]:
    """What units have told, from their results `dwell`; those from before it was kept are passed over, and those of
    a family that is no longer the same."""
    stored = [dwell["noise"] for dwell in dwells if dwell.get("noise")]
    return [to_likelihood(noise) for noise in stored if noise["family"] == len(general_log_weights(noise["longest"]))]


def to_likelihood(document: Mapping[str, Any]) -> NoiseLikelihood:
    """What a unit has told, from the log."""
    longest = int(document["longest"])
    likelihood = np.full((3, len(general_log_weights(longest))), -np.inf)
    variance = np.zeros_like(likelihood)
    likelihood[:, document["shapes"]] = document["log_likelihood"]
    variance[:, document["shapes"]] = document["log_variance"]
    return NoiseLikelihood(longest, likelihood, variance, float(document["dof"]))


def of_prior(prior: NoisePrior) -> dict[str, Any]:
    """All of a prior, bit for bit."""
    return {
        "longest": prior.longest,
        "units": prior.units,
        "log_weight": prior.log_weight.tolist(),
        "mean": prior.mean.tolist(),
        "covariance": prior.covariance.tolist(),
    }


def to_prior(dwell: Mapping[str, Any] | None) -> NoisePrior | None:
    """The prior that stands in a result `dwell`; None where none was used. Errors: LogError where it is damaged."""
    if not dwell or not dwell.get("prior"):
        return None
    stored = dwell["prior"]
    try:
        numbers = (np.array(stored[name], float) for name in ("log_weight", "mean", "covariance"))
        prior = NoisePrior(int(stored["longest"]), int(stored["units"]), *numbers)
        if len(prior.log_weight) != len(general_log_weights(prior.longest)):
            raise LogError("noise-prior-of-other-version")
        return prior
    except (KeyError, TypeError, ValueError) as exc:
        raise LogError("noise-prior-damaged", why=str(exc)) from exc
