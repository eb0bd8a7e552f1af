"""Placement of names beside marks on a screen, such that no name covers a mark or another name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

DIRECTIONS = (
    (1, 1),
    (-1, 1),
    (1, -1),
    (-1, -1),
    (1, 0),
    (-1, 0),
    (0, 1),
    (0, -1),
)  # directions from a mark to its name, in the order in which they are tried
GAPS = (8.0, 20.0, 34.0, 50.0, 70.0, 95.0, 125.0)  # distances from a mark to its name that are tried, in pixels
MARK = 6.0  # half a side of the square that a mark fills, in pixels
LEADER_POSITIONS = np.linspace(0.1, 1.0, 24)[:, None]  # tested points along a leader, from 0 (mark) to 1 (name)


class PlacedName(NamedTuple):
    """The position of a name on a picture, in pixels.

    centre: the middle of the name. leader_end: where the line from the mark ends at the name; None without such a line.
    """

    centre: tuple[float, float]
    leader_end: tuple[float, float] | None


def arrange_names(
    marks: Sequence[tuple[float, float]],
    sizes: Sequence[tuple[float, float]],
    frame: tuple[float, float],
    taken: Sequence[Box] = (),
) -> list[PlacedName | None]:
    """Place a name beside each mark, at the first free place; the nearest places in all DIRECTIONS are tried first.

    A name that is farther than the smallest distance gets a leader, a line from its mark. A free place is inside the
    frame. A name there overlaps no mark, no taken box, no other name and no other leader, and the name's own leader
    crosses no other name.

    Parameters
    ----------
    marks : sequence of (x, y)
        Marks in pixels from the lower left of the frame.
    sizes : sequence of (width, height)
        Size of each name in pixels.
    frame : (width, height)
        Size of the frame in pixels.
    taken : sequence of (left, bottom, right, top)
        Boxes that no name may cover.

    Returns
    -------
    list[PlacedName | None]
        The place of each name; None for a name without a free place.
    """
    boxes = [*taken, *((x - MARK, y - MARK, x + MARK, y + MARK) for x, y in marks)]
    leaders: list[Array] = []
    placed = []
    for mark, size in zip(marks, sizes, strict=True):
        found = _first_free_position(np.array(mark), np.array(size), frame, boxes, len(taken) + len(marks), leaders)
        placed.append(found)
        if found is not None:
            boxes.append(box_about(found.centre, size))
            leaders.append(_leader_points(np.array(mark), found.leader_end))
    return placed


def box_about(centre: tuple[float, float], size: tuple[float, float]) -> Box:
    """Return the box (left, bottom, right, top) of this size about a centre."""
    (x, y), (width, height) = centre, size
    return x - width / 2, y - height / 2, x + width / 2, y + height / 2


def is_overlapping(one: Box, other: Box) -> bool:
    """Return whether two boxes share more than an edge."""
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _first_free_position(
    mark: Array,
    size: Array,
    frame: tuple[float, float],
    boxes: Sequence[Box],
    first_name: int,
    leaders: Sequence[Array],
) -> PlacedName | None:
    for gap in GAPS:
        for across, up in DIRECTIONS:
            centre = mark + np.array([across, up]) * (size / 2 + (gap if 0 in (across, up) else 0.9 * gap))
            box = box_about((float(centre[0]), float(centre[1])), (float(size[0]), float(size[1])))
            if not (box[0] >= 0 and box[1] >= 0 and box[2] <= frame[0] and box[3] <= frame[1]):
                continue
            if any(is_overlapping(box, other) for other in boxes) or any(
                _leader_meets_box(leader, box) for leader in leaders
            ):
                continue
            end = tuple(np.clip(mark, box[:2], box[2:]).tolist()) if gap > GAPS[0] else None
            own = _leader_points(mark, end)
            if not any(_leader_meets_box(own, other) for other in boxes[first_name:]):
                return PlacedName((float(centre[0]), float(centre[1])), end)
    return None


def _leader_points(mark: Array, end: tuple[float, float] | None) -> Array:
    """Return points (k, 2) along the leader from a mark to `end`; an empty array if `end` is None (no leader)."""
    return np.empty((0, 2)) if end is None else mark + LEADER_POSITIONS * (np.array(end) - mark)


def _leader_meets_box(leader: Array, box: Box) -> bool:
    """Return whether a point of a leader line (k, 2) lies inside a box."""
    return bool(np.any(np.all((leader > box[:2]) & (leader < box[2:]), axis=1)))
