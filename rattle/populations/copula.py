"""Numbers that vary together: a Gaussian copula, with draws that share some of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import ParameterError, real_array, require
from rattle.numerics.sampling import uniforms
from rattle.populations.distributions import LEAST
from rattle.populations.normal import ndtr, ndtri

SYMMETRIC, POSITIVE = 1e-9, 1e-9  # errors of a matrix that was typed, and the least eigenvalue of one

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Copula:
    """Standard normal numbers with a matrix of correlations (d, d).

    Source: Kucherenko, Tarantola and Annoni, Computer Physics Communications 183 (2012) 937–946, for the draws that
    share some.
    """

    matrix: Array

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        object.__setattr__(self, "_root", np.linalg.cholesky(self.matrix))
        object.__setattr__(self, "_inverse", np.linalg.inv(self.matrix))

    def draws(self, seed: int, stream: int, rows: NDArray[np.int64]) -> Array:
        """Return numbers (n, d) of these rows of a stream: each row depends on its number and nothing else."""
        root: Array = self._root  # type: ignore[attr-defined]
        free = ndtri(uniforms(seed, stream, rows, len(self.matrix)))
        # Sums in one order, whatever the number of rows: products of matrices depend on it in the last bit.
        return np.stack([sum_of(root[i, : i + 1], free[:, : i + 1]) for i in range(len(root))], axis=1)

    def keeping(self, i: int, of: Array, fresh: Array) -> Array:
        """Return numbers with the i-th of `of`, the others drawn for it anew: from fresh ones, (n, d) as they."""
        found = fresh + self.matrix[i] * (of[:, i] - fresh[:, i])[:, None]
        found[:, i] = of[:, i]
        return found

    def but(self, i: int, of: Array, fresh: Array) -> Array:
        """Return numbers with all of `of` but the i-th, which is drawn for them anew."""
        found = of.copy()
        found[:, i] = fresh[:, i] + self._expected(i, of) - self._expected(i, fresh)
        return found

    def _expected(self, i: int, of: Array) -> Array:
        """Return the mean of the i-th, by the others."""
        inverse: Array = self._inverse[i]  # type: ignore[attr-defined]
        others = [j for j in range(len(inverse)) if j != i]
        return -sum_of(inverse[others], of[:, others]) / inverse[i]


def sum_of(weights: Array, columns: Array) -> Array:
    """Σ weights[j] columns[:, j], in the order of j."""
    total = np.zeros(len(columns))
    for weight, column in zip(weights, columns.T, strict=True):
        total = total + weight * column
    return total


def shares(z: Array) -> Array:
    """Shares of all that are below these numbers, as far as draws go."""
    return np.asarray(np.clip(ndtr(z), LEAST, 1.0 - LEAST))


def correlation_of(given: ArrayLike | None, names: tuple[str, ...]) -> Array:
    """Return the matrix (d, d) of numbers with these names, by default of independent ones. Raises ParameterError."""
    if given is None:
        return np.eye(len(names))
    matrix = real_array("correlation", given)
    order = f"rows and columns in this order: {', '.join(names)}"
    require(
        matrix.shape == (len(names), len(names)),
        f"the correlation must have a row and a column for each number that varies, {order}; got {matrix.shape}",
    )
    require(
        bool(np.isfinite(matrix).all() and (abs(matrix - matrix.T) <= SYMMETRIC).all()),
        f"a correlation matrix is symmetric: give the same number twice, {order}",
    )
    require(
        bool((abs(np.diag(matrix) - 1.0) <= SYMMETRIC).all() and (abs(matrix) <= 1.0 + SYMMETRIC).all()),
        "a correlation matrix has 1 on its diagonal and numbers from -1 to 1 beside it: for covariances divide each by "
        "both deviations",
    )
    matrix = 0.5 * (matrix + matrix.T)
    np.fill_diagonal(matrix, 1.0)
    least = float(np.linalg.eigvalsh(matrix)[0])
    if least < POSITIVE:
        fit = (1.0 - POSITIVE) / (1.0 - least)
        raise ParameterError(
            f"no numbers have these correlations (least eigenvalue {least:.3g}): multiply those beside the diagonal by "
            f"{0.99 * fit:.2g}, and of numbers that are functions of each other leave all but one out",
        )
    return matrix
