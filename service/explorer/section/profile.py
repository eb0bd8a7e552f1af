"""The profile of a map along a line in the plane: the values of the cells that the line crosses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gear_rattle.service.explorer.common.address import Pair, Ranges
from gear_rattle.service.explorer.map.colouring import block_values_or_nan, valueless_cells_by_reason
from gear_rattle.service.explorer.map.planes import MapBlock, MapPlane
from gear_rattle.workers.pictures.maps import colour_scale_of, map_title

#: Most values along δ and along ε that are read in the box around a line. If the box has more cells, several cells
#: share a value.
MOST_READ = (1024, 1024)
OUTSIDE = "outside of the survey"
Ends = tuple[Pair, Pair]


@dataclass(frozen=True)
class MapProfile:
    """Values (k,) of the cells along a line, NaN where a cell has no value.

    positions (k + 1,): where the line enters or leaves a cell, from 0 at the start of the line to 1 at its end.
    names: the meaning of each code; empty if the values are not codes. gaps: the share of the line without values, by
    the reason why they are missing. cells_per_value: (p, q) if a value stands for p cells of the survey along δ and q
    along ε.
    """

    title: str
    positions: np.ndarray
    values: np.ndarray
    names: Mapping[int, str]
    gaps: Mapping[str, float]
    cells_per_value: tuple[int, int]


def crossed_cells(box: Ranges, shape: tuple[int, int], ends: Ends) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the cells that a line crosses, and the positions along the line at which it enters and leaves them.

    Parameters
    ----------
    box : Ranges
        Ranges of δ and ε that all cells cover. Rows follow ε, columns δ; all rows, and all columns, are equally wide.
    shape : tuple[int, int]
        Numbers of rows and of columns.
    ends : Ends
        First and last point (δ, ε) of the line.

    Returns
    -------
    tuple[np.ndarray, np.ndarray, np.ndarray]
        Positions (k + 1,) from 0 to 1; row (k,) and column (k,) of the cell from each position to the next, −1 outside.
    """
    (x, y), (to_x, to_y) = ends
    ways = tuple(zip((x, y), (to_x, to_y), box, shape[::-1], strict=True))
    cuts = [np.array([0.0, 1.0])]
    for begin, end, (low, high), size in ways:
        if end != begin:
            at = (np.linspace(low, high, size + 1) - begin) / (end - begin)
            cuts.append(at[(at > 0) & (at < 1)])
    at = np.unique(np.concatenate(cuts))
    middle = (at[:-1] + at[1:]) / 2
    column, row = (
        np.floor((begin + middle * (end - begin) - low) / (high - low) * size).astype(int)
        for begin, end, (low, high), size in ways
    )
    outside = (row < 0) | (row >= shape[0]) | (column < 0) | (column >= shape[1])
    row[outside] = column[outside] = -1
    return at, row, column


def compute_profile(plane: MapPlane, ends: Ends) -> MapProfile:
    """Return the profile of a map along a line between two points (δ, ε). The call blocks: use a thread."""
    delta, epsilon = ((min(pair), max(pair)) for pair in zip(*ends, strict=True))
    block = plane.block((delta, epsilon), MOST_READ)
    shape = block.values.shape
    at, row, column = crossed_cells(block.box, (shape[0], shape[1]), ends)
    is_there = row >= 0
    values = np.where(is_there, block_values_or_nan(plane, block)[row, column], np.float32(np.nan))
    lengths = np.diff(at)
    without = {why: mask for why, (mask, _) in valueless_cells_by_reason(plane, block).items()}
    gaps = {why: float(lengths[is_there & mask[row, column]].sum()) for why, mask in without.items()}
    gaps[OUTSIDE] = float(lengths[~is_there].sum())
    _, _, codes, labels = colour_scale_of(plane.plane, values[np.isfinite(values)])
    names = {int(code): label for code, label in zip(codes, labels, strict=True)} if codes is not None else {}
    reasons = {why: share for why, share in gaps.items() if share > 0}
    return MapProfile(map_title(plane.plane), at, values, names, reasons, _cells_per_value(plane, block))


def _cells_per_value(plane: MapPlane, block: MapBlock) -> tuple[int, int]:
    """Return (p, q) if a value of a block stands for p cells of the map along δ and q cells along ε."""
    across, along = (
        round((high - low) / cells.size * (axis.size - 1) / (axis[-1] - axis[0]))
        for (low, high), cells, axis in zip(
            block.box, (block.delta, block.epsilon), (plane.delta, plane.epsilon), strict=True
        )
    )
    return int(across), int(along)


def profile_in_words(profile: MapProfile) -> str:
    """Return the caption of a profile: its map, the cells that it crosses, and its gaps."""
    cells = (
        "each cell"
        if profile.cells_per_value == (1, 1)
        else f"{profile.cells_per_value[0]} × {profile.cells_per_value[1]} cells as one"
    )
    gaps = "; ".join(f"{share:.2g} of the way: {why}" for why, share in profile.gaps.items())
    return f"{profile.title[:1].upper()}{profile.title[1:]}, along the diagram above: {cells} that it crosses." + (
        f" Gaps: {gaps}." if gaps else ""
    )
