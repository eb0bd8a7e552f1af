"""Covering relations in ball arithmetic: proofs that the impact map Π stretches one set across another.

A set is a parallelogram |ξ| ≤ 1, |η| ≤ 1 in its own coordinates, (t, v) = centre + ξ unstable + η stable. A set N
covers a set M if, in the coordinates of M, Π maps one edge ξ = ±1 of N to ξ < −1 and the other to ξ > 1, and maps no
point of N to |ξ| ≤ 1 ≤ |η| (Lemma 11 of docs/proofs.md). Sources: P. Zgliczyński, Nonlinearity 10 (1997) 243–252; J.
Kennedy and J. Yorke, Trans. AMS 353 (2001) 2513–2530.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

from rattle.errors import NotProvedError
from rattle.proof.balls import arb, arb_mat, ball
from rattle.proof.chaos.images import ImageOfSet, enclose_image
from rattle.proof.flights import ModelPoint

Pair = tuple[Fraction, Fraction]
#: A set is cut into at most this number of parts; parts that are cut further count too.
MOST_SET_PARTS = 12_000
#: Smallest half-width of a part, as a share of the half-width of its set.
SMALLEST_PART = 2.0**-12


class SetPart(NamedTuple):
    """A part of a set: |ξ − xi| ≤ width and |η − eta| ≤ height, in the coordinates of the set."""

    xi: float
    eta: float
    width: float
    height: float


WHOLE = SetPart(0.0, 0.0, 1.0, 1.0)
#: The edges ξ = −1 and ξ = 1 of a set.
EDGES = {side: SetPart(float(side), 0.0, 0.0, 1.0) for side in (-1, 1)}


@dataclass(frozen=True)
class HSet:
    """An h-set in exact numbers: the parallelogram (t, v) = centre + ξ unstable + η stable, |ξ| ≤ 1, |η| ≤ 1."""

    centre: Pair
    unstable: Pair
    stable: Pair

    @cached_property
    def matrix(self) -> arb_mat:
        """The matrix that maps the coordinates (ξ, η) of the set to (t, v) − centre."""
        return arb_mat([[ball(self.unstable[i]), ball(self.stable[i])] for i in range(2)])

    @cached_property
    def inverse_matrix(self) -> arb_mat:
        """The matrix that maps (t, v) − centre to coordinates (ξ, η). Raises NotProvedError if the set has no area."""
        (a, b), (c, d) = self.matrix.tolist()
        size = a * d - b * c
        if not (size > 0 or size < 0):
            raise NotProvedError(
                "the sides of a parallelogram of states are parallel: choose sides in different directions"
            )
        return arb_mat([[d / size, -b / size], [-c / size, a / size]])

    @cached_property
    def centre_column(self) -> arb_mat:
        """The centre of the set as a column vector (2, 1)."""
        return arb_mat(2, 1, [ball(x) for x in self.centre])

    def corners(self) -> Iterator[Pair]:
        """Yield the four corners (t, v) of the set."""
        for x in (-1, 1):
            for y in (-1, 1):
                t, v = (c + x * u + y * s for c, u, s in zip(self.centre, self.unstable, self.stable, strict=True))
                yield t, v


@dataclass
class MappedSet:
    """A set, and the images under Π of its parts.

    walls: the walls that the motions from the set must meet between two impacts on Σ⁺. images: {part: its image}, None
    for a part whose motions are not proved to meet these walls.
    """

    point: ModelPoint
    source: HSet
    walls: tuple[int, ...]
    images: dict[SetPart, ImageOfSet | None] = field(default_factory=dict)

    def image(self, part: SetPart) -> ImageOfSet | None:
        """Return the image of a part, or None if the motions from the part are not proved to meet `walls`."""
        if part not in self.images:
            matrix = self.source.matrix
            centre = self.source.centre_column + matrix * arb_mat(2, 1, [part.xi, part.eta])
            sides = matrix * arb_mat([[part.width, 0], [0, part.height]])
            try:
                self.images[part] = enclose_image(self.point, (centre[0, 0], centre[1, 0]), sides, self.walls)
            except NotProvedError:
                self.images[part] = None
        return self.images[part]

    def require_covering(self, target: HSet, periods: int) -> None:
        """Prove that the set covers `target`, shifted by this number of forcing periods (Lemma 11 of docs/proofs.md).

        Raises
        ------
        NotProvedError
            If the covering is not proved.
        """
        left = self._side_of_edge(target, periods, EDGES[-1])
        right = self._side_of_edge(target, periods, EDGES[1])
        if left == right:
            raise NotProvedError(
                "both edges of a parallelogram of states are mapped to the same side of the next parallelogram, which "
                "is therefore not covered"
            )
        for _ in self._sides_of_parts(target, periods, WHOLE, inside_allowed=True):
            pass

    def _side_of_edge(self, target: HSet, periods: int, edge: SetPart) -> int:
        """Return the side of `target` to which an edge is mapped: 1 (ξ > 1) or −1 (ξ < −1). Raises NotProvedError."""
        sides = set(self._sides_of_parts(target, periods, edge, inside_allowed=False))
        if len(sides) != 1:
            raise NotProvedError(
                "an edge of a parallelogram of states is mapped to both sides of the next parallelogram, which is "
                "therefore not proved to be covered"
            )
        return sides.pop()

    def _sides_of_parts(self, target: HSet, periods: int, part: SetPart, inside_allowed: bool) -> Iterator[int]:
        """Cut a part until each smaller part's image is proved to lie on one side of `target`, and yield these sides.

        inside_allowed: whether the image of a smaller part may have |ξ| ≤ 1, if it has |η| < 1.

        Yields
        ------
        int
            1 for an image with ξ > 1, −1 for one with ξ < −1, and, if `inside_allowed`, 0 for one with |η| < 1.

        Raises
        ------
        NotProvedError
            If the side is not proved even for the smallest parts, or an image lies where the covering forbids it.
        """
        parts, number = [part], 0
        while parts:
            here, number = parts.pop(), number + 1
            if number > MOST_SET_PARTS:
                raise NotProvedError(
                    f"a covering is not proved with {MOST_SET_PARTS:,} parts of a parallelogram of states: use a "
                    "smaller parallelogram"
                )
            found = self.image(here)
            extents = [1.0, 1.0]
            if found is not None:
                (xi, eta), extents = _coordinates_in_target(target, periods, found)
                if xi > 1 or xi < -1:
                    yield 1 if xi > 1 else -1
                    continue
                if inside_allowed and abs(eta) < 1:
                    yield 0
                    continue
                if _is_cutting_useless(xi, eta, extents, inside_allowed):
                    raise NotProvedError(
                        "a parallelogram of states is not proved to be stretched across the next parallelogram"
                    )
            parts += _halve_part(here, extents)


def _coordinates_in_target(target: HSet, periods: int, part_image: ImageOfSet) -> tuple[tuple[arb, arb], list[float]]:
    """Return a part's image in the coordinates (ξ, η) of the target, which is shifted by `periods` forcing periods.

    Returns
    -------
    tuple[tuple[arb, arb], list[float]]
        Balls of ξ and η over the image. Then, for each half side of the image (a vector), the larger of its two
        extents, in ξ and in η.
    """
    away = arb_mat(2, 1, [part_image.middle[0] - periods, part_image.middle[1]]) - target.centre_column
    start, slope = target.inverse_matrix * away, target.inverse_matrix * part_image.slope
    xi, eta = (start[i, 0] + arb(0, 1) * sum((abs(slope[i, j]) for j in range(2)), arb(0)) for i in range(2))
    return (xi, eta), [max(float(abs(slope[i, j]).upper()) for i in range(2)) for j in range(2)]


def _is_cutting_useless(xi: arb, eta: arb, extents: Sequence[float], inside_allowed: bool) -> bool:
    """Return whether cutting a part further cannot help to prove a covering.

    xi, eta: the part's image in the target's coordinates. extents: for each side of the part the extent of its image.
    inside_allowed: whether the image may lie at |ξ| < 1, if it has |η| < 1.

    Returns
    -------
    bool
        True if the image lies where the covering forbids it, or is so small that cutting would not decide its position.
    """
    return max(extents) < SMALLEST_PART * 8 or bool(abs(xi) < 1 and (abs(eta) > 1 or not inside_allowed))


def _halve_part(part: SetPart, extents: Sequence[float]) -> list[SetPart]:
    """Cut a part in two: halve its side whose image is longer.

    extents: for each side of the part the extent of the side's image, from `_coordinates_in_target`.

    Returns
    -------
    list[SetPart]
        The halves.

    Raises
    ------
    NotProvedError
        If the part is already smaller than SMALLEST_PART.
    """
    xi, eta, width, height = part
    if max(width, height) < SMALLEST_PART:
        raise NotProvedError(
            "a covering is not proved even with the smallest parts of a parallelogram of states: use a smaller "
            "parallelogram"
        )
    if (extents[0] * (width > 0), width) >= (extents[1], height):
        return [SetPart(xi + side * width / 2, eta, width / 2, height) for side in (-1, 1)]
    return [SetPart(xi, eta + side * height / 2, width, height / 2) for side in (-1, 1)]
