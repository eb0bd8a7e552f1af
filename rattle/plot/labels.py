"""Place labels in a picture so that they do not cover lines or each other."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from rattle.plot.drawing import HALO, lay_out_axes

Array = NDArray[np.float64]
Point = tuple[float, float]

#: The distances in points (1/72 inch), and the directions in radians, in which places for a label are tried around the
#: point that the label names.
DISTANCES = (20, 30, 42, 56, 72, 90)
DIRECTIONS = np.arange(24) / 24 * 2 * np.pi
#: Free space around a label, in pixels.
ROOM = 3.0
#: Number of points of a line that are tried for a label that cannot run along the line.
ANCHORS = 24
#: A label inside a part of the axes is tried at the centres of at most this many cells, beginning with the cells that
#: have the most free space around them.
CANDIDATES = 400
#: A label beside a line clearly names this line if all other lines are at least this far from the label, in pixels.
CLEAR_DISTANCE = 45.0
#: FAULT_COST: cost of each serious fault, such as covering a label or a marker. OUTSIDE_COST: cost of leaving the axes.
FAULT_COST, OUTSIDE_COST = 1000.0, 1e5
#: Largest cost of covering lines. It is below FAULT_COST, so a label covers lines rather than labels or markers.
MOST_LINE_COST = 800.0


class Labels:
    """The labels of one picture. Each label is placed where it covers least.

    Creating this object lays out the axes, because the free places depend on their shape.
    """

    def __init__(self, axes: Axes, lines: Sequence[Array]) -> None:
        """Prepare to place labels that keep clear of these lines and of the texts in the axes.

        lines: arrays (k, 2) of points in data coordinates, with NaN between the pieces of a line.
        """
        figure = axes.get_figure(root=True)
        assert figure is not None
        self.axes, self.renderer = axes, lay_out_axes(figure).get_renderer()
        self.frame = axes.get_window_extent(self.renderer)
        self.covered = np.concatenate(
            [np.empty((0, 2)), *(_densify_line(axes.transData.transform(line)) for line in lines)]
        )
        self.boxes = [text.get_window_extent(self.renderer) for text in axes.texts]
        self.leaders: list[Array] = []

    def keep_clear_of(self, markers: Sequence[Point], size: float) -> None:
        """Let no later label cover these markers. markers: (x, y) in data coordinates; size: diameter in points."""
        half = np.full(2, self.renderer.points_to_pixels(size) / 2)
        self.boxes += [_box_around_centre(self.axes.transData.transform(marker), half) for marker in markers]

    def add(
        self,
        name: str,
        *points: Point,
        size: float = 8,
        colour: str = "black",
        room: float = ROOM,
        white_edge: bool = False,
    ) -> Annotation:
        """Write a name near one of several points, where the name covers least, with a line to that point.

        points: (x, y) in data coordinates. room: the free space around the label in pixels. white_edge: whether the
        line gets a white edge.

        Returns
        -------
        Annotation
            The text.
        """
        text = self.axes.annotate(
            name,
            points[0],
            (0, 0),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=size,
            color=colour,
            arrowprops={
                "arrowstyle": "-",
                "linewidth": 0.8,
                "shrinkA": 0,
                "shrinkB": 3,
                "color": colour,
                "path_effects": HALO if white_edge else None,
            },
            path_effects=HALO,
            zorder=5,
        )
        half = np.array(Annotation.get_window_extent(text, self.renderer).size) / 2 + room
        pixels = self.renderer.points_to_pixels(1.0)
        offsets = [
            distance * np.array([np.cos(angle), np.sin(angle)]) for distance in DISTANCES for angle in DIRECTIONS
        ]
        least, best = np.inf, (np.zeros(2), points[0], offsets[0])
        for point in points:
            origin = self.axes.transData.transform(point)
            for offset in offsets:
                cost = self._label_cost(origin, origin + pixels * offset, half, least)
                if cost < least:
                    least, best = cost, (origin, point, offset)
        origin, text.xy, offset = best
        text.set_position(tuple(offset))
        centre = origin + pixels * offset
        self.boxes.append(_box_around_centre(centre, half))
        self.leaders.append(np.array([origin, centre]))
        return text

    def add_along_line(self, name: str, line: Array, size: float = 9, colour: str = "black") -> Text:
        """Write a name beside a line (k, 2) in data coordinates, parallel to it.

        If there is no room for this, write the name near a point of the line, with a short line to the point (`add`).

        Returns
        -------
        Text
            The text.
        """
        text = self.axes.text(0, 0, name, fontsize=size, color=colour, path_effects=HALO, zorder=5)
        text.set(ha="center", va="center", rotation_mode="anchor")
        half = np.array(Text.get_window_extent(text, self.renderer).size) / 2 + ROOM
        fine = _densify_line(self.axes.transData.transform(line))
        others = self.covered[_distances_to_nearest(self.covered, fine[:: max(1, len(fine) // 2000)]) > 6.0]
        stretch = max(2, int(2 * half[0] / 4))
        places = [
            (self._parallel_label_cost(centre, angle, bend, half, others), centre, angle)
            for start in range(0, max(len(fine) - stretch, 0), max(1, stretch // 6))
            for centre, angle, bend in _label_positions_beside_line_part(fine[start : start + stretch], half[1])
        ]
        cost, centre, angle = min(places, key=lambda place: place[0], default=(OUTSIDE_COST, np.zeros(2), 0.0))
        if cost >= FAULT_COST:
            text.remove()
            inside = line[~np.isnan(line[:, 0])]
            chosen = inside[:: max(1, len(inside) // ANCHORS)]
            return self.add(name, *((float(x), float(y)) for x, y in chosen), size=size, colour=colour)
        self._move_text(text, centre)
        text.set_rotation(np.degrees(angle))
        self.boxes.append(_upright_box_around_turned_box(centre, half, angle))
        return text

    def add_name_within(self, name: str, inside: NDArray[np.bool_], size: float = 13) -> bool:
        """Write a name inside a part of the axes, where the part is widest, in smaller type if necessary.

        Parameters
        ----------
        inside : NDArray[np.bool_]
            An even grid (rows, columns) of cells over the axes, from their lower left corner; True for cells of the
            part.

        Returns
        -------
        bool
            False if there is no room; then nothing is written.
        """
        text = self.axes.text(0, 0, name, ha="center", va="center", weight="bold", path_effects=HALO, zorder=5)
        cells, room = self._cells_and_distances(inside)
        roomiest = np.argsort(-room, kind="stable")[:CANDIDATES]
        for smaller in (1.0, 0.75):
            text.set_fontsize(smaller * size)
            half = np.array(Text.get_window_extent(text, self.renderer).size) / 2 + ROOM
            for centre in cells[roomiest]:
                box = _box_around_centre(centre, half)
                if not (self._misplacement_cost(box) or self._count_covered_points(centre, half)):
                    self._move_text(text, centre)
                    self.boxes.append(box)
                    return True
        text.remove()
        return False

    def widest_free_position(self, inside: NDArray[np.bool_]) -> tuple[Point, float]:
        """Return the place in a part of the axes that is farthest from lines, labels and the edges of the axes.

        inside: the cells of the part, as in `add_name_within`. The place is the centre of one of these cells.

        Returns
        -------
        tuple[Point, float]
            The centre in data coordinates, and its distance in pixels.
        """
        cells, room = self._cells_and_distances(inside)
        best = int(np.argmax(room))
        x, y = self.axes.transData.inverted().transform(cells[best])
        return (float(x), float(y)), float(room[best])

    def _cells_and_distances(self, inside: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return the centres (n, 2), in pixels, of cells `inside`, and their distances from lines, labels, edges."""
        rows, columns = inside.shape
        i, j = np.nonzero(inside)
        share = np.column_stack([(j + 0.5) / columns, (i + 0.5) / rows])
        cells = np.array(self.frame.min) + share * np.array(self.frame.size)
        edge = np.minimum(cells - self.frame.min, np.array(self.frame.max) - cells).min(axis=1)
        room = np.minimum(edge, _distances_to_nearest(cells, self.covered))
        for box in self.boxes:
            away = np.maximum(np.maximum(box.min - cells, cells - box.max), 0.0)
            room = np.minimum(room, np.hypot(*away.T))
        return cells, room

    def _move_text(self, text: Text, centre: Array) -> None:
        """Move a text so that its centre is at `centre`, in pixels."""
        x, y = self.axes.transData.inverted().transform(centre)
        text.set_position((float(x), float(y)))

    def _count_covered_points(self, centre: Array, half: Array) -> int:
        """Return the number of points of lines that a label would cover; half: half of its width and height."""
        return int(np.all(np.abs(self.covered - centre) < half, axis=1).sum())

    def _label_cost(self, origin: Array, centre: Array, half: Array, most: float) -> float:
        """Return the cost of a label at `centre` for a point at `origin`.

        half: half of the label's width and height. most: the cost at which the computation stops.

        Returns
        -------
        float
            The cost if it is below `most`, otherwise a lower bound of the cost that is at least `most`.
        """
        cost = float(np.hypot(*(centre - origin)))
        if cost >= most:
            return cost
        cost += self._misplacement_cost(_box_around_centre(centre, half)) + min(
            20 * self._count_covered_points(centre, half), MOST_LINE_COST
        )
        if cost >= most:
            return cost
        leader = np.array([origin, centre])
        dense = _densify_line(leader)
        crossed = sum(_are_segments_crossing(leader, other) for other in self.leaders)
        return cost + FAULT_COST * (crossed + sum(other.count_contains(dense) > 0 for other in self.boxes))

    def _parallel_label_cost(self, centre: Array, angle: float, bend: float, half: Array, others: Array) -> float:
        """Return the cost of a label along a line.

        centre, angle: centre and direction of the label. bend: how far the line beside the label deviates from a
        straight one, in pixels. half: half of the label's width and height. others: points of other lines.

        Returns
        -------
        float
            The cost; FAULT_COST or more if the label must not be there.
        """
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        hidden = np.all(np.abs((self.covered - centre) @ turn) < half, axis=1).sum()
        near = float(_distances_to_nearest(centre[None], others)[0]) if len(others) else CLEAR_DISTANCE
        cost = FAULT_COST * (hidden > 0) + 4 * max(0.0, CLEAR_DISTANCE - near) + 10 * bend + 20 * abs(np.sin(angle))
        # among places of equal cost, the place nearest to the middle of the picture is best
        middle = float(np.abs((centre - self.frame.min) / self.frame.size - 0.5).max())
        return float(cost + 30 * middle) + self._misplacement_cost(_upright_box_around_turned_box(centre, half, angle))

    def _misplacement_cost(self, box: Bbox) -> float:
        """Return the cost of covering other labels and of leaving the axes."""
        outside = not (self.frame.contains(*box.min) and self.frame.contains(*box.max))
        return FAULT_COST * sum(box.overlaps(other) for other in self.boxes) + OUTSIDE_COST * outside


def _label_positions_beside_line_part(part: Array, half_height: float) -> list[tuple[Array, float, float]]:
    """Return two places for a label, one on each side of a part of a line; no place if the part has a row of NaN.

    part: the points (k, 2) of the part, in pixels. half_height: half of the label's height, in pixels.

    Returns
    -------
    list[tuple[Array, float, float]]
        (centre, angle, bend) of each place: the centre of the label in pixels, its direction in radians, and how far
        the part deviates from a straight line in pixels.
    """
    if np.isnan(part).any():
        return []
    chord = part[-1] - part[0]
    angle = float(np.arctan2(chord[1], chord[0]))
    angle = (angle + np.pi / 2) % np.pi - np.pi / 2  # at most a quarter turn, so that the label is not upside down
    normal = np.array([-np.sin(angle), np.cos(angle)])
    off = (part - part[0]) @ normal
    bend = float(np.ptp(off))
    middle = 0.5 * (part[0] + part[-1])
    return [
        (middle + normal * (extreme + side * half_height), angle, bend)
        for side, extreme in ((1, float(off.max())), (-1, float(off.min())))
    ]


def _distances_to_nearest(points: Array, others: Array) -> Array:
    """Return the distance of each point (n, 2) to the nearest of `others`, whose rows of NaN are ignored.

    Returns
    -------
    Array
        Distances (n,); inf for a point that is NaN, and if `others` is empty.
    """
    from scipy.spatial import cKDTree  # imported here, because this takes a tenth of a second

    others = others[~np.isnan(others).any(axis=1)]
    if not len(others):
        return np.full(len(points), np.inf)
    found: Array = np.full(len(points), np.inf)
    real = ~np.isnan(points).any(axis=1)
    found[real] = cKDTree(others).query(points[real])[0]
    return found


def _box_around_centre(centre: Array, half: Array) -> Bbox:
    """Return a box from its centre and half of its width and height."""
    return Bbox([centre - half, centre + half])


def _upright_box_around_turned_box(centre: Array, half: Array, angle: float) -> Bbox:
    """Return the smallest upright box around a box turned by `angle`. half: half the turned box's width and height."""
    cosine, sine = abs(np.cos(angle)), abs(np.sin(angle))
    return _box_around_centre(centre, np.array([cosine * half[0] + sine * half[1], sine * half[0] + cosine * half[1]]))


def _densify_line(line: Array) -> Array:
    """Return points at most four pixels apart along a line (k, 2), whose coordinates are in pixels."""
    steps = np.nan_to_num(np.hypot(*np.diff(line, axis=0).T))
    number = np.arange(len(line))
    along = np.concatenate([[0.0], np.cumsum(np.minimum(steps, 1e4) / 4 + 1e-9)])
    fine = np.interp(np.arange(0.0, along[-1] + 1.0), along, number)
    return np.column_stack([np.interp(fine, number, column) for column in line.T])


def _are_segments_crossing(first: Array, second: Array) -> bool:
    """Return whether two line segments cross, each given by its two end points (2, 2)."""
    (a, b), (c, d) = first, second
    return _side_of_line(a, b, c) * _side_of_line(a, b, d) < 0 and _side_of_line(c, d, a) * _side_of_line(c, d, b) < 0


def _side_of_line(a: Array, b: Array, c: Array) -> float:
    """Return a positive number if c is to the left of the line from a to b, negative if it is to the right."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
