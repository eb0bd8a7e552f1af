"""Covering relations in balls: which set the impact map Π stretches across which other (lemma 11 of docs/proofs.md).

A set is a parallelogram |ξ| ≤ 1, |η| ≤ 1 in its own coordinates, (t, v) = centre + ξ unstable + η stable. N covers M if

    Π maps the edges ξ = −1 and ξ = 1 of N beyond opposite edges of M, and
    Π maps no point of N to where |ξ| ≤ 1 ≤ |η| in the coordinates of M.

Sources: P. Zgliczyński, Nonlinearity 10 (1997) 243–252; J. Kennedy and J. Yorke, Trans. AMS 353 (2001) 2513–2530.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

from rattle.errors import NotProvedError
from rattle.proof.balls import arb, arb_mat, ball
from rattle.proof.chaos.images import Image, image
from rattle.proof.flights import ModelPlane

Pair = tuple[Fraction, Fraction]
MOST_PIECES = 12_000
FINEST = 2.0**-12  # half-width of the smallest part, where the set has half-width 1


class SetPart(NamedTuple):
    """The part |ξ − xi| ≤ width, |η − eta| ≤ height of a set."""

    xi: float
    eta: float
    width: float
    height: float


WHOLE = SetPart(0.0, 0.0, 1.0, 1.0)
EDGES = {side: SetPart(float(side), 0.0, 0.0, 1.0) for side in (-1, 1)}


@dataclass(frozen=True)
class HSet:
    """A parallelogram of states (t, v), given exactly by its centre and two half-sides."""

    centre: Pair
    unstable: Pair
    stable: Pair

    @cached_property
    def matrix(self) -> arb_mat:
        """Matrix (2, 2) that maps (ξ, η) to (t, v) − centre."""
        return arb_mat([[ball(self.unstable[i]), ball(self.stable[i])] for i in range(2)])

    @cached_property
    def coordinates(self) -> arb_mat:
        """Matrix (2, 2) that maps (t, v) − centre to (ξ, η)."""
        (a, b), (c, d) = self.matrix.tolist()
        size = a * d - b * c
        if not (size > 0 or size < 0):
            raise NotProvedError("the sides of a set are parallel, so it has no area")
        return arb_mat([[d / size, -b / size], [-c / size, a / size]])

    @cached_property
    def middle(self) -> arb_mat:
        """Return the centre of the set as a ball vector (2, 1)."""
        return arb_mat(2, 1, [ball(x) for x in self.centre])

    def corners(self) -> Iterator[Pair]:
        """Yield the four corners of the set."""
        for x in (-1, 1):
            for y in (-1, 1):
                t, v = (c + x * u + y * s for c, u, s in zip(self.centre, self.unstable, self.stable, strict=True))
                yield t, v


@dataclass
class Mapped:
    """A set and the images of its parts under Π. Its motions meet `walls` between two impacts on Σ⁺."""

    plane: ModelPlane
    source: HSet
    walls: tuple[int, ...]
    images: dict[SetPart, Image | None] = field(default_factory=dict)

    def image(self, part: SetPart) -> Image | None:
        """Enclose the image of a part under Π. None means that the order of impacts is not proved."""
        if part not in self.images:
            matrix = self.source.matrix
            centre = self.source.middle + matrix * arb_mat(2, 1, [part.xi, part.eta])
            sides = matrix * arb_mat([[part.width, 0], [0, part.height]])
            try:
                self.images[part] = image(self.plane, (centre[0, 0], centre[1, 0]), sides, self.walls)
            except NotProvedError:
                self.images[part] = None
        return self.images[part]

    def require_covers(self, target: HSet, periods: int) -> None:
        """Raise NotProvedError unless the set covers the target, shifted by a number of forcing periods."""
        left = self._side(target, periods, EDGES[-1])
        right = self._side(target, periods, EDGES[1])
        if left == right:
            raise NotProvedError("both edges of a set map to the same side of the next set")
        for _ in self._settled(target, periods, WHOLE, inside=True):
            pass

    def _side(self, target: HSet, periods: int, edge: SetPart) -> int:
        """Return the side (−1 or 1) of the target to which an edge maps as a whole."""
        sides = set(self._settled(target, periods, edge, inside=False))
        if len(sides) != 1:
            raise NotProvedError("an edge of a set maps to both sides of the next set")
        return sides.pop()

    def _settled(self, target: HSet, periods: int, part: SetPart, inside: bool) -> Iterator[int]:
        """Yield the proved position of each part relative to the target set.

        Yields
        ------
        int
            1 or −1 for a part beyond an edge. 0, where `inside` allows it, for a part that lies between the edges and
            clear of the other two sides.

        Raises
        ------
        NotProvedError
            If the position of a part remains undecided.
        """
        parts, number = [part], 0
        while parts:
            here, number = parts.pop(), number + 1
            if number > MOST_PIECES:
                raise NotProvedError("the image of a set needs too many parts")
            found = self.image(here)
            grown = [1.0, 1.0]
            if found is not None:
                (xi, eta), grown = _seen_from(target, periods, found)
                if xi > 1 or xi < -1:
                    yield 1 if xi > 1 else -1
                    continue
                if inside and abs(eta) < 1:
                    yield 0
                    continue
                if _is_refuted(xi, eta, grown, inside):
                    raise NotProvedError("a set is not stretched across the next set")
            parts += _halves(here, grown)


def _seen_from(target: HSet, periods: int, found: Image) -> tuple[tuple[arb, arb], list[float]]:
    """Return ξ and η of an image in the target's coordinates, and the contribution of each side to their width."""
    away = arb_mat(2, 1, [found.middle[0] - periods, found.middle[1]]) - target.middle
    start, slope = target.coordinates * away, target.coordinates * found.slope
    xi, eta = (start[i, 0] + arb(0, 1) * sum((abs(slope[i, j]) for j in range(2)), arb(0)) for i in range(2))
    return (xi, eta), [max(float(abs(slope[i, j]).upper()) for i in range(2)) for j in range(2)]


def _is_refuted(xi: arb, eta: arb, grown: Sequence[float], inside: bool) -> bool:
    """Return whether halving would not help: the image is already small, and lies where it must not."""
    return max(grown) < FINEST * 8 or bool(abs(xi) < 1 and (abs(eta) > 1 or not inside))


def _halves(part: SetPart, grown: Sequence[float]) -> list[SetPart]:
    xi, eta, width, height = part
    if max(width, height) < FINEST:
        raise NotProvedError("the walls that the motions of a set meet are undecided")
    if (grown[0] * (width > 0), width) >= (grown[1], height):
        return [SetPart(xi + side * width / 2, eta, width / 2, height) for side in (-1, 1)]
    return [SetPart(xi, eta + side * height / 2, width, height / 2) for side in (-1, 1)]
