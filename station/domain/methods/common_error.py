"""What results of a process say of the error that all of them share: that of gravity, of the field or of the rate.

Results of units about a mean m have their own mean at m + s, s being what the reference is wrong by. One figure does
not part the two, but some pairs are likelier than others: m lies exactly at nominal, or 2 or 4 times as far out as
units lie about it, each coefficient by itself, or all together the way that s goes, which looks most like s. These
five count the same (model averaging: Hoeting et al. 1999, Statist. Sci. 14, 382). Each is normal, so that its s and
its weight are closed.
"""

import numpy as np

from station.domain.core.types import Floats

#: How far out a process mean lies that is not at nominal, in standard deviations of its units.
FAR = (2.0, 4.0)


def common_error(mean: Floats, mean_std: Floats, process_std: Floats, shared: Floats) -> tuple[Floats, Floats]:
    """Mean and standard deviation (u, c) of the shared error. mean (u, c): of results, less nominal; mean_std (u, c):
    its standard deviation by the number of results; process_std (u, c) of units; shared (u, c, c): covariance of s."""
    covariance = _process_means(process_std, shared) + shared + _diagonal(mean_std**2)
    gain = np.linalg.solve(covariance, np.broadcast_to(shared, covariance.shape)).swapaxes(-1, -2)
    error = np.einsum("muij,uj->mui", gain, mean)
    variance = np.einsum("uii->ui", shared) - np.einsum("muij,uji->mui", gain, shared)
    square = np.einsum("ui,mui->mu", mean, np.linalg.solve(covariance, mean[None, ..., None])[..., 0])
    log = -(square + np.linalg.slogdet(covariance)[1]) / 2
    weight = np.exp(log - log.max(axis=0))[..., None]
    weight = weight / weight.sum(axis=0)
    found = (weight * error).sum(axis=0)
    return found, np.sqrt((weight * (np.maximum(variance, 0.0) + (error - found) ** 2)).sum(axis=0))


def _process_means(std: Floats, shared: Floats) -> Floats:
    """Covariances (m, u, c, c) of the process mean, one a model."""
    root = np.sqrt(np.einsum("uii->ui", shared))
    along = shared / np.maximum(root[:, :, None] * root[:, None, :], np.finfo(float).tiny)
    scale = std[:, :, None] * std[:, None, :]
    return np.stack([np.zeros_like(scale), *(far**2 * scale * s for far in FAR for s in (np.eye(std.shape[1]), along))])


def _diagonal(variance: Floats) -> Floats:
    return variance[..., None] * np.eye(variance.shape[-1])
