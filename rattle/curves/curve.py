"""A bifurcation curve in the (δ, ε) plane: its points in order, its pieces, and where and why each of them ends."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.arclength import Problem, with_value
from rattle.errors import require, require_number
from rattle.numerics.complex_step import Array

SAME_POINT = 1e-9


@dataclass(frozen=True)
class End:
    """An end of a piece: the index of its point, and why the curve ends there."""

    index: int
    reason: str


class Piece(NamedTuple):
    """A connected piece as it was followed: unknowns (k, N) with δ, ε last, and why each end is one."""

    points: Array
    reasons: tuple[str, str]


class Described(NamedTuple):
    """The motion at a point of a curve."""

    tau: float
    v: float
    multipliers: NDArray[np.complex128]


@dataclass(frozen=True)
class Curve:
    """A bifurcation curve at half-backlash beta, n points in the order of its pieces; n = 0 where it does not exist.

    delta, epsilon (n,): the point; tau, v (n,): phase in [0, 1) and speed after the impact on Σ⁺ of the motion that
    bifurcates; multipliers (2, n): its Floquet multipliers (on a grazing curve those of the motion that just misses the
    wall); arclength (n,): along (δ, ε) from the start of the piece; piece (n,): number of the connected piece. folds:
    points at which δ turns back. ends: both ends of each piece. Dimensionless, phases in forcing periods.
    """

    name: str
    beta: float
    delta: NDArray[np.float64]
    epsilon: NDArray[np.float64]
    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    arclength: NDArray[np.float64]
    piece: NDArray[np.int64]
    folds: tuple[int, ...]
    ends: tuple[End, ...]
    _problem: Problem = field(repr=False)
    _points: tuple[Array, ...] = field(repr=False)

    def __len__(self) -> int:
        """Number of points."""
        return self.delta.size

    def at(self, delta: float | None = None, epsilon: float | None = None) -> tuple[float, ...]:
        """Every ε of the curve at this damping, or every δ at this eccentricity: rising, each solved for to rounding.

        Empty where it has none. Raises ParameterError unless one of the two is given.
        """
        given = [(name, x) for name, x in (("delta", delta), ("epsilon", epsilon)) if x is not None]
        require(len(given) == 1, "give delta or epsilon, not both")
        name, value = given[0][0], require_number(*given[0])
        index = -2 if name == "delta" else -1
        found = (crossings(self._problem, points, index, value) for points in self._points)
        return tuple(sorted({float(x[-3 - index]) for each in found for x in each}))


def crossings(problem: Problem, points: Array, index: int, value: float) -> list[Array]:
    """The solutions with this δ (index −2) or ε (−1) on a followed piece (k, N), each once."""
    found: list[Array] = []
    d = points[:, index] - value
    for i in np.flatnonzero((d[:-1] <= 0) & (d[1:] >= 0) | (d[:-1] >= 0) & (d[1:] <= 0)):
        rise = d[i + 1] - d[i]
        share = -d[i] / rise if rise else 0.0
        x = with_value(problem, points[i] + share * (points[i + 1] - points[i]), index, value)
        if x is not None and not any(np.max(np.abs((x - other)[-2:])) < SAME_POINT for other in found):
            found.append(x)
    return found


def build(
    name: str, beta: float, problem: Problem, pieces: Sequence[Piece], described: Sequence[Sequence[Described]]
) -> Curve:
    """A curve of followed pieces, with what is known of the motion at each point."""
    motions = [motion for piece in described for motion in piece]
    sizes = [len(piece.points) for piece in pieces]
    starts = np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)])
    plane = np.concatenate([np.empty((0, 2)), *(piece.points[:, -2:] for piece in pieces)])
    lengths = [_arclength(piece.points[:, -2:]) for piece in pieces]
    ends = [
        end
        for start, size, piece in zip(starts, sizes, pieces, strict=False)
        for end in (End(int(start), piece.reasons[0]), End(int(start) + size - 1, piece.reasons[1]))
    ]
    folds = [int(start) + i for start, piece in zip(starts, pieces, strict=False) for i in _folds(piece.points[:, -2])]
    return Curve(
        name,
        beta,
        plane[:, 0],
        plane[:, 1],
        np.array([motion.tau for motion in motions]),
        np.array([motion.v for motion in motions]),
        np.array([motion.multipliers for motion in motions], np.complex128).reshape(-1, 2).T,
        np.concatenate([np.empty(0), *lengths]),
        np.repeat(np.arange(len(pieces)), sizes),
        tuple(folds),
        tuple(ends),
        problem,
        tuple(piece.points for piece in pieces),
    )


def _arclength(plane: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(plane, axis=0).T))])


def _folds(delta: Array) -> list[int]:
    rises = np.sign(np.diff(delta))
    return [int(i) + 1 for i in np.flatnonzero(rises[:-1] * rises[1:] < 0)]
