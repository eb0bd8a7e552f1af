"""Draw correlated random numbers by a Gaussian copula, and draw some of them again while the others are kept."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import ParameterError, require, require_real_array
from rattle.numerics.sampling import draw_uniforms
from rattle.populations.distributions import LEAST
from rattle.populations.normal import ndtr, ndtri

#: Largest allowed error in the symmetry and in the diagonal of a given correlation matrix.
SYMMETRY_ERROR = 1e-9
#: Least allowed eigenvalue of a correlation matrix.
LEAST_EIGENVALUE = 1e-9

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Copula:
    """A source of d standard normal numbers with a correlation matrix (d, d).

    Some of the d numbers can also be drawn again while the others keep their values, as in Kucherenko, Tarantola and
    Annoni, Computer Physics Communications 183 (2012) 937–946.
    """

    matrix: Array
    _root: Array = field(init=False, repr=False)  # Cholesky factor of the matrix
    _inverse: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Compute the Cholesky factor and the inverse of the matrix."""
        object.__setattr__(self, "_root", np.linalg.cholesky(self.matrix))
        object.__setattr__(self, "_inverse", np.linalg.inv(self.matrix))

    def draw_rows(self, seed: int, stream: int, rows: NDArray[np.int64]) -> Array:
        """Draw n rows of d correlated standard normal numbers.

        rows (n,): the number of each row. A row of d numbers depends only on the seed, the stream and the row's number.

        Returns
        -------
        Array
            The correlated numbers (n, d).
        """
        root = self._root
        free = ndtri(draw_uniforms(seed, stream, rows, len(self.matrix)))
        # explicit sums, because the last bit of a matrix product may depend on the number of rows
        return np.stack([weighted_sum(root[i, : i + 1], free[:, : i + 1]) for i in range(len(root))], axis=1)

    def redraw_other_columns(self, i: int, z: Array, fresh: Array) -> Array:
        """Return z (n, d) with all columns but the i-th drawn again, conditioned on the i-th column, which is kept.

        fresh: rows (n, d) that `draw_rows` drew independently of z; the new columns are computed from them.

        Returns
        -------
        Array
            The numbers (n, d).
        """
        found = fresh + self.matrix[i] * (z[:, i] - fresh[:, i])[:, None]
        found[:, i] = z[:, i]
        return found

    def redraw_column(self, i: int, z: Array, fresh: Array) -> Array:
        """Return z (n, d) with its i-th column drawn again, conditioned on the other columns, which are kept.

        fresh: rows (n, d) that `draw_rows` drew independently of z; the new column is computed from them.

        Returns
        -------
        Array
            The numbers (n, d).
        """
        found = z.copy()
        found[:, i] = fresh[:, i] + self._conditional_mean(i, z) - self._conditional_mean(i, fresh)
        return found

    def _conditional_mean(self, i: int, z: Array) -> Array:
        """Return the conditional mean (n,) of the i-th column of z (n, d), given the other columns."""
        inverse = self._inverse[i]
        others = [j for j in range(len(inverse)) if j != i]
        return -weighted_sum(inverse[others], z[:, others]) / inverse[i]


def weighted_sum(weights: Array, columns: Array) -> Array:
    """Return Σ weights[j] columns[:, j], with the terms added in the order of j, so that all bits are reproducible."""
    total = np.zeros(len(columns))
    for weight, column in zip(weights, columns.T, strict=True):
        total = total + weight * column
    return total


def normal_probabilities(z: Array) -> Array:
    """Return the probability u of a standard normal number below z, limited to LEAST ≤ u ≤ 1 − LEAST."""
    return np.asarray(np.clip(ndtr(z), LEAST, 1.0 - LEAST))


def check_correlation_matrix(given: ArrayLike | None, names: tuple[str, ...]) -> Array:
    """Return the checked correlation matrix (d, d) of numbers with these names; for None the identity matrix.

    Returns
    -------
    Array
        The matrix, exactly symmetric, with 1 on its diagonal.

    Raises
    ------
    ParameterError
        The matrix is no correlation matrix of d numbers.
    """
    if given is None:
        return np.eye(len(names))
    matrix = require_real_array("correlation", given)
    order = f"rows and columns in this order: {', '.join(names)}"
    require(
        matrix.shape == (len(names), len(names)),
        f"the correlation matrix must have a row and a column for each number that varies, {order}; got shape "
        f"{matrix.shape}",
    )
    require(
        bool(np.isfinite(matrix).all() and (abs(matrix - matrix.T) <= SYMMETRY_ERROR).all()),
        f"a correlation matrix must be symmetric and finite, {order}",
    )
    require(
        bool((abs(np.diag(matrix) - 1.0) <= SYMMETRY_ERROR).all() and (abs(matrix) <= 1.0 + SYMMETRY_ERROR).all()),
        "a correlation matrix must have 1 on its diagonal and numbers from -1 to 1 elsewhere: for covariances divide "
        "each by both deviations",
    )
    matrix = 0.5 * (matrix + matrix.T)
    np.fill_diagonal(matrix, 1.0)
    least = float(np.linalg.eigvalsh(matrix)[0])
    if least < LEAST_EIGENVALUE:
        fit = (1.0 - LEAST_EIGENVALUE) / (1.0 - least)
        raise ParameterError(
            f"these correlations are impossible, or make some numbers functions of others (least eigenvalue "
            f"{least:.3g}): leave out such numbers, or multiply the entries off the diagonal by {0.99 * fit:.2g}",
        )
    return matrix
