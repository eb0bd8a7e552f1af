"""Stable and unstable manifolds of any saddle of Π^k, in smooth pieces that end at the corners that Γ causes.

The map F, its multiplier λ along the manifold, and the local manifold W(t) for |t| ≤ size are those of
`rattle.orbits.saddles`. A point of the manifold is F^j(W(t)) with t in the fundamental domain (size/λ, size], so that
one number s = t λ^j gives its position. New points are inserted along t. Each point therefore lies on the true manifold
to the accuracy of its own orbit: the map stretches rounding errors along the manifold and contracts them across it.
Refinement by distance and angle follows B. Krauskopf and H. M. Osinga, J. Comput. Phys. 146 (1998) 404.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.errors import RattleError, require, require_number
from rattle.orbits.periodic_motions import PeriodicMotion
from rattle.orbits.saddles import Array, LocalManifold, local_manifold

# most points of an image of the fundamental domain; most images of a manifold; most refinements of an image
MOST_POINTS, MOST_IMAGES, MOST_ROUNDS = 400_000, 2_000, 200
SHORTEST_IMAGE = 1e-9  # length of an image below which the manifold counts as converged to an attractor
DOMAIN_POINTS = 9  # number of points of the fundamental domain before it is refined
# a step beside a sharp turn is halved only if it is longer than this: sharp turns of shorter steps are rounding errors
FINEST = 1e-6
# two pieces share a corner if the distance between their ends is smaller than this factor times the largest spacing
CORNER_GAP = 1e-3


@dataclass(frozen=True)
class Manifold:
    """One side of a manifold, outwards from the saddle: n points in p smooth pieces.

    Attributes
    ----------
    kind, side
        "stable" or "unstable", and +1 or −1, as in `manifold`.
    tau, v : ndarray, (n,)
        Phase, continuous along the manifold so that it may leave [0, 1), and speed after the impact on Σ⁺.
    images : ndarray of int, (n,)
        For each point a number j: the point lies in the j-th image of the fundamental domain.
    parameter : ndarray, (n,)
        For each point the position t of its j-th preimage on the local manifold; near the saddle |t| is the arclength.
        t lies in the fundamental domain or, for j = 0, between the saddle and the domain.
    pieces : ndarray of int, (p + 1,)
        Piece i has the points pieces[i] to pieces[i + 1]. Neighbouring pieces share their corner, which is stored
        twice.
    gap : ndarray, (p − 1,)
        Distance between the ends of neighbouring pieces; 0 where they share a corner.
    length : float
        Arclength of the whole side.
    """

    orbit: PeriodicMotion
    kind: str
    side: int
    tau: Array
    v: Array
    parameter: Array
    images: NDArray[np.int64]
    pieces: NDArray[np.int64]
    gap: Array
    length: float


class _DomainImage:
    """The j-th image of the fundamental domain of a local manifold, as points in order away from the saddle.

    t (n,): the positions, in the domain, of the points' j-th preimages. ok, x, word, bounces: the results of
    `LocalManifold.map` for these preimages: flags of existing images, the images (2, n), hashes of their itineraries,
    and their numbers of impacts on Σ⁻.
    """

    def __init__(self, local: LocalManifold, j: int, t: Array) -> None:
        self.local, self.j, self.t = local, j, t
        self.ok, self.x, self.word, self.bounces = self._images_of(t)

    def _images_of(self, t: Array) -> tuple[NDArray[np.bool_], Array, NDArray[np.int64], NDArray[np.int64]]:
        return self.local.map(self.local.states_at(t), self.j)

    def _insert_images(self, t: Array) -> None:
        """Insert the j-th images of further points of the fundamental domain. t (k,): positions of these points."""
        t = t[np.argsort(np.abs(t))]
        ok, x, word, bounces = self._images_of(t)
        at = np.searchsorted(np.abs(self.t), np.abs(t))
        self.t, self.x = np.insert(self.t, at, t), np.insert(self.x, at, x, axis=1)
        self.ok, self.word = np.insert(self.ok, at, ok), np.insert(self.word, at, word)
        self.bounces = np.insert(self.bounces, at, bounces)

    @property
    def corner_flags(self) -> NDArray[np.bool_]:
        """Flags (n − 1,): True if the manifold has a corner between a point and the next point."""
        return np.asarray(self.word[1:] != self.word[:-1])

    def _bisect_corners(self) -> bool:
        """Insert the two points beside each corner that are a rounding error apart in t; return whether any is new."""
        i = np.flatnonzero(self.corner_flags)
        low, high, word = self.t[i], self.t[i + 1], self.word[i]
        while True:
            middle = 0.5 * (low + high)
            open_ = (middle != low) & (middle != high)
            if not open_.any():
                break
            before = self._images_of(middle)[2] == word
            low, high = np.where(open_ & before, middle, low), np.where(open_ & ~before, middle, high)
        new = np.setdiff1d(np.concatenate([low, high]), self.t)
        if new.size:
            self._insert_images(new)
        return bool(new.size)

    def refine(self, spacing: float, angle: float) -> None:
        """Insert points until, except at corners, neighbours are closer than `spacing` and turns are below `angle`."""
        for _ in range(MOST_ROUNDS):
            cornered = self._bisect_corners()
            step = _state_differences(self.x, self.local.unit)
            size, same = np.hypot(*step), ~self.corner_flags
            turn = np.abs(np.angle(np.exp(1j * np.diff(np.arctan2(step[1], step[0])))))
            sharp, rough = (turn > angle) & same[1:] & same[:-1], np.zeros(size.size, np.bool_)
            rough[1:] |= sharp
            rough[:-1] |= sharp
            middle = 0.5 * (self.t[1:] + self.t[:-1])
            todo = same & ((size > spacing) | (rough & (size > FINEST)))
            todo &= (middle != self.t[1:]) & (middle != self.t[:-1])
            if todo.any():
                self._insert_images(middle[todo])
            elif not cornered:
                return
            if self.t.size > MOST_POINTS:
                raise RattleError(
                    f"the manifold needs more than {MOST_POINTS} points: give a smaller arclength or a larger spacing"
                )


def manifold(
    orbit: PeriodicMotion,
    kind: str,
    side: int,
    arclength: float,
    spacing: float = 0.02,
    angle: float = 0.2,
    unit: float = 1.0,
) -> Manifold:
    """Return one side of the "stable" or "unstable" manifold of a saddle, up to an arclength in (τ, v).

    The manifold ends earlier where it converges to a stable motion or to rest. A part that crosses Γ and
    returns between two neighbouring points is missed.

    Parameters
    ----------
    side : int
        +1 leaves the saddle towards rising v (rising τ where v does not change), −1 the other way.
    arclength, spacing : float
        Length to follow, and largest distance of neighbours.
    angle : float
        Largest turn between neighbours, in radians.
    unit : float
        The speed difference that counts as one forcing period in arclength, spacing and angle. If speeds are far from
        1, use a seventh of the largest speed of interest.

    Returns
    -------
    Manifold
        Points outwards from the saddle, in pieces; all numbers dimensionless.

    Raises
    ------
    ParameterError
        If the orbit is not a saddle, or another argument is outside its domain.
    RattleError
        If no local manifold is found, mostly because the saddle is close to grazing, or too many points are needed.
    """
    require(kind in ("stable", "unstable"), f"kind must be stable or unstable, got {kind!r}")
    require(side in (1, -1), f"side must be +1 or -1, got {side!r}")
    arclength = require_number("arclength", arclength, positive=True)
    spacing, angle = require_number("spacing", spacing, positive=True), require_number("angle", angle, positive=True)
    unit = require_number("unit", unit, positive=True)
    local = local_manifold(orbit, kind == "stable", unit)
    t = side * local.size * local.multiplier ** np.linspace(-1.0, 0.0, DOMAIN_POINTS)
    reach = float(
        abs(t[0]) * np.hypot(*(local.series_coefficients[1] / [1.0, unit])) / np.hypot(*local.series_coefficients[1])
    )
    first = np.linspace(0.0, t[0], 2 + int(reach / spacing))[:-1]  # positions between the saddle and the domain
    zero = np.zeros(first.size)
    rows, length = [np.stack([*local.states_at(first), first, zero, zero, zero])], reach
    for j in range(MOST_IMAGES):
        level = _DomainImage(local, j, t)
        level.refine(spacing, angle)
        t, end = level.t, int(np.argmin(np.append(level.ok, False)))
        rows.append(_points_of_image(level, end))
        more = float(np.hypot(*_state_differences(level.x[:, :end], unit)).sum())
        length += more
        if length > arclength or end < t.size or more < SHORTEST_IMAGE:
            break
    return _assemble_manifold(orbit, kind, side, np.concatenate(rows, axis=1), arclength, CORNER_GAP * spacing, unit)


def _state_differences(x: Array, unit: float) -> Array:
    """Return the differences (2, n − 1) of successive states (2, n), with v in units of `unit`."""
    return np.asarray(np.diff(x, axis=1) / [[1.0], [unit]], np.float64)


def _points_of_image(level: _DomainImage, end: int) -> Array:
    """Return the points of the j-th image of the fundamental domain as rows (6, n).

    The rows are: τ, v, position t of the point's j-th preimage in the domain, j, whether a piece begins, and number of
    impacts on Σ⁻. Points from number `end` on are left out, because point `end` has no image. If j > 0 the first point
    is left out too, because it is the last point of image j − 1.

    Returns
    -------
    Array
        The rows.
    """
    begins = np.concatenate([[False], level.corner_flags])
    rows = np.stack([*level.x, level.t, np.full(level.t.size, level.j), begins, level.bounces])
    return np.asarray(rows[:, (1 if level.j else 0) : end], np.float64)


def _assemble_manifold(
    orbit: PeriodicMotion, kind: str, side: int, rows: Array, arclength: float, largest_gap: float, unit: float
) -> Manifold:
    """Join the points of all images of the fundamental domain to a manifold, and cut it off at the arclength.

    rows: as `_points_of_image` returns them, one image after another. largest_gap: two pieces share a corner if the
    distance between their ends is smaller. The point of a corner is taken from the piece with fewer impacts on Σ⁻,
    on which it is exact.

    Returns
    -------
    Manifold
        The manifold.
    """
    walked = np.concatenate([[0.0], np.cumsum(np.hypot(*_state_differences(rows[:2], unit)))])
    rows = rows[:, : int(np.searchsorted(walked, arclength, side="right"))]
    starts = np.flatnonzero(rows[4])
    gap = np.hypot(*((rows[:2, starts] - rows[:2, starts - 1]) / [[1.0], [unit]]))
    near = starts[gap < largest_gap]
    exact = np.where(rows[5, near] < rows[5, near - 1], near, near - 1)
    # a corner is exact on the piece with fewer impacts on Σ⁻; on the other piece its error is about the square root of
    # a rounding error
    rows[:, np.where(exact == near, near - 1, near)] = rows[:, exact]
    pieces = np.concatenate([[0], starts, [rows.shape[1]]]).astype(np.int64)
    length = float(np.hypot(*_state_differences(rows[:2], unit)).sum())
    tau, v, t, j = rows[:4]
    gap = np.where(gap < largest_gap, 0.0, gap)
    return Manifold(orbit, kind, side, tau, v, t, j.astype(np.int64), pieces, gap, length)
