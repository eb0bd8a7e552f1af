"""Covering relations in balls: which set the impact map stretches across which other.

A set is a parallelogram |ξ| ≤ 1, |η| ≤ 1 in coordinates of its own, (t, v) = centre + ξ unstable + η stable. N covers M
if Π maps the edges ξ = ±1 of N beyond those of M, one to either side, and no point of N to where |ξ| ≤ 1 ≤ |η| in M's
coordinates. (P. Zgliczyński, Nonlinearity 10 (1997) 243–252; J. Kennedy and J. Yorke, Trans. AMS 353 (2001) 2513–2530.)
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
FINEST = 2.0**-12  # half-width of a piece, of a set


class SetPart(NamedTuple):
    """A part of a set: |ξ − xi| ≤ width, |η − eta| ≤ height."""

    xi: float
    eta: float
    width: float
    height: float


WHOLE = SetPart(0.0, 0.0, 1.0, 1.0)
EDGES = {side: SetPart(float(side), 0.0, 0.0, 1.0) for side in (-1, 1)}


@dataclass(frozen=True)
class HSet:
    """A parallelogram of states (t, v): its centre and half its sides, exactly."""

    centre: Pair
    unstable: Pair
    stable: Pair

    @cached_property
    def matrix(self) -> arb_mat:
        """(t, v) − centre of (ξ, η)."""
        return arb_mat([[ball(self.unstable[i]), ball(self.stable[i])] for i in range(2)])

    @cached_property
    def coordinates(self) -> arb_mat:
        """(ξ, η) of (t, v) − centre."""
        (a, b), (c, d) = self.matrix.tolist()
        size = a * d - b * c
        if not (size > 0 or size < 0):
            raise NotProvedError("a set has no area")
        return arb_mat([[d / size, -b / size], [-c / size, a / size]])

    @cached_property
    def middle(self) -> arb_mat:
        """Return the centre of the set (2, 1)."""
        return arb_mat(2, 1, [ball(x) for x in self.centre])

    def corners(self) -> Iterator[Pair]:
        """Yield the corners of the set."""
        for x in (-1, 1):
            for y in (-1, 1):
                t, v = (c + x * u + y * s for c, u, s in zip(self.centre, self.unstable, self.stable, strict=True))
                yield t, v


@dataclass
class Mapped:
    """A set and what Π makes of its parts, whose motions meet these walls between two impacts on Σ⁺."""

    plane: ModelPlane
    source: HSet
    walls: tuple[int, ...]
    images: dict[SetPart, Image | None] = field(default_factory=dict)

    def image(self, part: SetPart) -> Image | None:
        """Π of a part, or None if it is not proved what its motions meet."""
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
        """Raise NotProvedError unless the set covers another, so many forcing periods later."""
        left = self._side(target, periods, EDGES[-1])
        right = self._side(target, periods, EDGES[1])
        if left == right:
            raise NotProvedError("both edges of a set go to one side of the next")
        for _ in self._settled(target, periods, WHOLE, inside=True):
            pass

    def _side(self, target: HSet, periods: int, edge: SetPart) -> int:
        """Return to which side of a set an edge goes, all of it."""
        sides = set(self._settled(target, periods, edge, inside=False))
        if len(sides) != 1:
            raise NotProvedError("an edge of a set goes to both sides of the next")
        return sides.pop()

    def _settled(self, target: HSet, periods: int, part: SetPart, inside: bool) -> Iterator[int]:
        """Yield what is proved of the parts of a part.

        Yields
        ------
        int
            1 or −1 for the side of the set that they go to, 0 if between its edges and clear of the other two, where
            they may.

        Raises
        ------
        NotProvedError
            If a part stays undecided.
        """
        parts, number = [part], 0
        while parts:
            here, number = parts.pop(), number + 1
            if number > MOST_PIECES:
                raise NotProvedError("a set has too many parts")
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
                    raise NotProvedError("a set is not stretched across the next")
            parts += _halves(here, grown)


def _seen_from(target: HSet, periods: int, found: Image) -> tuple[tuple[arb, arb], list[float]]:
    """ξ and η of an image, and how much of their width is due to either side of the part."""
    away = arb_mat(2, 1, [found.middle[0] - periods, found.middle[1]]) - target.middle
    start, slope = target.coordinates * away, target.coordinates * found.slope
    xi, eta = (start[i, 0] + arb(0, 1) * sum((abs(slope[i, j]) for j in range(2)), arb(0)) for i in range(2))
    return (xi, eta), [max(float(abs(slope[i, j]).upper()) for i in range(2)) for j in range(2)]


def _is_refuted(xi: arb, eta: arb, grown: Sequence[float], inside: bool) -> bool:
    """Return whether finer parts would not help: the image is small, and where it should not be."""
    return max(grown) < FINEST * 8 or bool(abs(xi) < 1 and (abs(eta) > 1 or not inside))


def _halves(part: SetPart, grown: Sequence[float]) -> list[SetPart]:
    xi, eta, width, height = part
    if max(width, height) < FINEST:
        raise NotProvedError("it is not told what the motions of a set meet")
    if (grown[0] * (width > 0), width) >= (grown[1], height):
        return [SetPart(xi + side * width / 2, eta, width / 2, height) for side in (-1, 1)]
    return [SetPart(xi, eta + side * height / 2, width, height / 2) for side in (-1, 1)]
