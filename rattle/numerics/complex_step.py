"""Exact derivatives by a complex step, and a smooth function that is 0 where a matrix is singular."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

COMPLEX_STEP = 1e-40
Array = NDArray[np.float64]
Function = Callable[[NDArray], NDArray]


@lru_cache(maxsize=64)
def _complex_steps(n: int) -> NDArray[np.complex128]:
    """Return i · COMPLEX_STEP times the unit matrix (n, n): row j is the step in variable j."""
    steps = (1j * COMPLEX_STEP * np.eye(n)).astype(np.complex128)
    steps.setflags(write=False)
    return steps


def value_and_jacobian(function: Function, x: Array) -> tuple[Array, Array]:
    """Return the value and the Jacobian of a real-analytic function (…, N) → (…, M) at x (…, N).

    Returns
    -------
    tuple[Array, Array]
        Value (…, M) and Jacobian (…, M, N), exact to rounding.
    """
    values = function(x[..., None, :] + _complex_steps(x.shape[-1]))
    return values[..., 0, :].real, values.imag.swapaxes(-1, -2) / COMPLEX_STEP


def to_complex_batch(x: NDArray) -> NDArray[np.complex128]:
    """Return arguments x (…, N), real or complex, as a contiguous complex array (k, N) for kernels."""
    return np.ascontiguousarray(x, np.complex128).reshape(-1, x.shape[-1])


def reshape_like(x: NDArray, results: NDArray, axis: int = 0) -> NDArray:
    """Return the results of a kernel for the k arguments `to_complex_batch(x)`, with the leading axes of x (…, N).

    results: an array whose axis number `axis` has the length k. The leading axes of x take the place of this axis.

    Returns
    -------
    NDArray
        The results, real if x is real.
    """
    if x.ndim != 2:
        results = results.reshape(results.shape[:axis] + x.shape[:-1] + results.shape[axis + 1 :])
    return results if x.dtype.kind == "c" else results.real


def singularity_function(matrix: NDArray, column: Array, row: Array) -> NDArray:
    """Return a smooth function (…,) that vanishes together with the determinant of a matrix (…, n, n).

    With a column b and a row c (…, n), or (n,) for all matrices, the function is the last unknown g of the bordered
    system M x + b g = 0, c x = 1. If b and c are close to the null vectors of M, g is well scaled for any n.
    Source: W. Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (SIAM 2000).

    Returns
    -------
    NDArray
        The function's values.
    """
    n = matrix.shape[-1]
    system = np.zeros((*matrix.shape[:-2], n + 1, n + 1), matrix.dtype)
    system[..., :n, :n], system[..., :n, n], system[..., n, :n] = matrix, column, row
    right = np.zeros((*matrix.shape[:-2], n + 1, 1), matrix.dtype)
    right[..., n, 0] = 1.0
    return np.linalg.solve(system, right)[..., n, 0]
