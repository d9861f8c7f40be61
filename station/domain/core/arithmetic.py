"""What a processor's arithmetic is known by: linear algebra and functions round as suits each processor."""

import hashlib
from functools import cache

import numpy as np


@cache
def fingerprint() -> str:
    """The same text wherever a fixed set of sums, products, solutions and functions comes out bit for bit the same.

    BLAS picks its kernels by the processor (or OPENBLAS_CORETYPE), numpy its loops; both sum in orders of their own.
    """
    values = np.modf(np.arange(1.0, 4097.0) * (np.sqrt(5.0) - 1.0) / 2.0)[0]  # spread evenly over (0, 1)
    square = values[:2304].reshape(48, 48) + 4.0 * np.eye(48)
    stack = values.reshape(-1, 4, 4) + np.eye(4)
    parts = [
        *(values[:n] @ values[1 : n + 1] for n in (3, 24, 333, 4000)),
        *(values.sum(), values.reshape(64, 64).sum(axis=0), np.einsum("ij,kj->ik", square, square)),
        *(square @ square, square[:, :3].T @ square[:, :3], stack @ stack),
        *(np.linalg.solve(square, values[:48]), np.linalg.solve(stack, stack[::-1]), np.linalg.eigvalsh(square)),
        *(np.linalg.svd(square[:, :9])[1], np.linalg.cholesky(square @ square.T), np.linalg.qr(square[:, :9])[1]),
        *(f(values) for f in (np.exp, np.log, np.sin, np.arctan, np.sqrt)),
        np.fft.rfft(values).view(float),
    ]
    return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()[:16]
