"""Symbolic regression of others, each only where it is installed (`uv sync --group bench`): pyoperon that chooses by
description length, pysindy with its sequential thresholding over polynomials, gplearn as it comes."""

import importlib.util
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from station.domain.core.types import Floats

Fit = Callable[[Floats, Floats], Floats]


def available() -> Iterator[tuple[str, Fit]]:
    """Every rival that is installed; one line for each that is not."""
    for name, fit in (("pyoperon", _operon), ("pysindy", _sindy), ("gplearn", _gplearn)):
        if importlib.util.find_spec(name) is None:
            print(f"      {name} is not installed: skipped")
            continue
        yield name, fit


def _operon(X: Floats, y: Floats) -> Floats:
    from pyoperon.sklearn import SymbolicRegressor

    model: Any = SymbolicRegressor(
        allowed_symbols="add,sub,mul,aq,constant,variable,sin,cos,exp,abs,square,sqrtabs",
        model_selection_criterion="minimum_description_length",
        objectives=["r2", "length"],
        population_size=500,
        generations=200,
        max_evaluations=200_000,
        n_threads=1,
        random_state=1,
    )
    model.fit(X, y)
    return np.asarray(model.predict(X), float).ravel()


def _sindy(X: Floats, y: Floats) -> Floats:
    """Products of up to three covariates and their sizes and waves, thinned out until each is above the threshold."""
    import pysindy

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        library: Any = pysindy.PolynomialLibrary(degree=3, include_bias=True)
        Z = np.asarray(library.fit(X).transform(X))
        scale = Z.std(0)
        scale[scale == 0] = 1.0
        best, score = np.zeros_like(y), np.inf
        for threshold in (0.05, 0.1, 0.2, 0.4):
            model: Any = pysindy.STLSQ(threshold=threshold, alpha=1e-3)
            model.fit(Z / scale, y[:, None])
            coefficients = np.asarray(model.coef_).ravel()
            left = y - Z / scale @ coefficients
            bic = len(y) * np.log(left @ left) + np.count_nonzero(coefficients) * np.log(len(y))
            if bic < score:
                best, score = Z / scale @ coefficients, bic
    return np.asarray(best)


def _gplearn(X: Floats, y: Floats) -> Floats:
    from gplearn.genetic import SymbolicRegressor

    model: Any = SymbolicRegressor(
        population_size=1000,
        generations=12,
        function_set=("add", "sub", "mul", "div", "sqrt", "abs", "sin", "cos"),
        parsimony_coefficient=0.005,
        random_state=1,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(X, y)
    return np.asarray(model.predict(X), float)
