"""Eigenvectors of normal matrices and singular vectors of others, whatever rounding has left in them."""

import numpy as np
import scipy

from station.domain.core.types import Floats


def eigenvectors(normal: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues (…, n), rising, and eigenvectors (…, n, n), one a column, of symmetric matrices (…, n, n).

    LAPACK's divide and conquer ends without a result for some matrices in which many eigenvalues are equal and rounding
    stands beside them; the QR algorithm, which takes several times as long, does not.
    """
    try:
        values, vectors = np.linalg.eigh(normal)
    except np.linalg.LinAlgError:
        each = [scipy.linalg.eigh(one, driver="ev") for one in normal.reshape(-1, *normal.shape[-2:])]
        values, vectors = (np.stack(part) for part in zip(*each, strict=True))
        values, vectors = values.reshape(normal.shape[:-1]), vectors.reshape(normal.shape)
    return np.asarray(values), np.asarray(vectors)


def pseudo_inverse(normal: Floats, cut: float) -> Floats:
    """Pseudo-inverse (…, n, n) of symmetric matrices (…, n, n); cut: directions whose eigenvalue is no more than such a
    share of the largest are left out."""
    values, vectors = eigenvectors(normal)
    size = np.abs(values)
    kept = size > cut * size.max(axis=-1, keepdims=True, initial=0.0)
    inverse = np.where(kept, 1 / np.where(kept, values, 1.0), 0.0)
    return np.asarray((vectors * inverse[..., None, :]) @ vectors.swapaxes(-1, -2))


def left_singular_vectors(columns: Floats) -> tuple[Floats, Floats]:
    """Left singular vectors (u, M, k) and singular values (u, k), falling, of matrices (u, M, p); k the lesser of M and
    p. Where divide and conquer gives up, as above, by the QR algorithm."""
    try:
        vectors, values, _ = np.linalg.svd(columns, full_matrices=False)
    except np.linalg.LinAlgError:
        each = [scipy.linalg.svd(one, full_matrices=False, lapack_driver="gesvd") for one in columns]
        vectors, values, _ = (np.stack(part) for part in zip(*each, strict=True))
    return np.asarray(vectors), np.asarray(values)
