"""Choose the colours of a map, and their meanings.

By default a map has the colours of the REST picture map.png. A viewer may change the limits and the scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.colors import to_hex

from gear_rattle.service.explorer.common.address import Limits, Pair, Ranges
from gear_rattle.service.explorer.map.planes import UNSEEN, MapBlock, MapPlane, Room
from gear_rattle.workers.pictures.figure import innermost_cells, region_name_positions
from gear_rattle.workers.pictures.largest import OTHERS
from gear_rattle.workers.pictures.look import LARGEST, colour_limits, logarithmic_scale_limits
from gear_rattle.workers.pictures.maps import (
    ZERO,
    colour_scale_of,
    colours_of_codes,
    map_title,
    valueless_layers,
    words_for_missing_value,
)

SHADES = 256
#: The map shows the name of a family whose width is at least the share LEAST_WIDTH of the map. The name is left out if
#: the name of a wider family is nearer than NAME_SIZE: 130 pixels along δ and 24 pixels along ε.
LEAST_WIDTH, NAME_SIZE = 0.02, (130, 24)


@dataclass(frozen=True)
class LegendColour:
    """Colour of a map, its meaning (`label`), and its share.

    share: if the colour means a code, such as a region, the code's share of the computed cells. If it means a reason
    why cells show no value, such as a value not above 0 on a log scale, the share of these cells among all cells.
    """

    label: str
    colour: str
    share: float


@dataclass(frozen=True)
class Colouring:
    """Colours of a map.

    reasons: uint8 (epsilon, delta), 0 where the colour of a cell shows its value. A number i > 0 means that the cell
    has the colour `reason_colours[i - 1]` instead, for example because a log scale cannot show its value. low,
    high: range of the colours; on a categorical map the first code less 0.5, and the last code plus 0.5. log: True if
    the colours are evenly spaced in the logarithm of the value.
    """

    title: str
    palette: Sequence[str]
    low: float
    high: float
    log: bool
    categorical: bool
    shades: tuple[LegendColour, ...]
    reasons: np.ndarray
    reason_colours: tuple[str, ...]
    note: str = ""
    # names of regions or families, each with the point (δ, ε) where it is written
    names: Mapping[str, Pair] = field(default_factory=dict)
    shares_beyond: Pair = (0.0, 0.0)  # shares of the values below `low` and above `high`


def valueless_cells_by_reason(plane: MapPlane, block: MapBlock) -> dict[str, tuple[np.ndarray, str]]:
    """Return {reason why cells have no value: (mask of these cells, their colour)}."""
    variable = str(plane.plane.name)
    return valueless_layers(variable, block.values, block.status, words_for_missing_value(plane.plane))


def _share_of_code(block: MapBlock, code: int, shown: np.ndarray, computed: int) -> float:
    """Return the share of the computed cells that have the value `code`, also where a drawn cell stands for several."""
    if block.shares:
        return block.shares.get(code, 0.0)
    return float((shown == code).sum() / max(computed, 1))


def block_values_or_nan(plane: MapPlane, block: MapBlock) -> np.ndarray:
    """Return the values of a block, NaN where a cell has no value."""
    without = np.logical_or.reduce([mask for mask, _ in valueless_cells_by_reason(plane, block).values()])
    return np.where(without, np.float32(np.nan), block.values)


def values_in_window(plane: MapPlane, window: Ranges, room: Room) -> tuple[np.ndarray, Ranges]:
    """Return the values of the cells in a window, and the box of these cells. This function blocks: use a thread."""
    block = plane.block(window, room)
    return block_values_or_nan(plane, block), block.box


def compute_colouring(
    plane: MapPlane, block: MapBlock, limits: Limits | Pair, log: bool, room: Room = UNSEEN
) -> Colouring:
    """Return the colours of the cells `block` of a map of `room` pixels. This function blocks: use a thread."""
    values, variable = block.values, str(plane.plane.name)
    layers = valueless_cells_by_reason(plane, block)
    reasons = np.zeros(values.shape, np.uint8)
    for number, (mask, _) in enumerate(layers.values(), start=1):
        reasons[mask] = number
    shown = values[reasons == 0].astype(float)
    cmap, norm, codes, labels = colour_scale_of(plane.plane, shown)
    computed = int((block.status != 0).sum())
    nothing = words_for_missing_value(plane.plane)
    shades = tuple(
        LegendColour(label, colour, float((reasons == number).sum() / reasons.size))
        if block.without is None or label != nothing
        else LegendColour(label, colour, block.without)
        for number, (label, (_, colour)) in enumerate(layers.items(), start=1)
        if (reasons == number).any()
    )
    reason_colours = tuple(to_hex(colour) for _, colour in layers.values())
    shades = tuple(LegendColour(each.label, to_hex(each.colour), each.share) for each in shades)
    if codes is not None and labels:
        every = range(int(codes[0]), int(codes[-1]) + 1)
        colours = [to_hex(cmap(norm(code))) for code in every]
        # colours of all families: a window may show families that the drawing of the whole map does not show
        if variable == LARGEST:
            colours = list(colours_of_codes(plane.plane))
            every = range(len(colours))
        named = tuple(
            LegendColour(label, colours[every.index(int(code))], _share_of_code(block, int(code), shown, computed))
            for code, label in zip(codes, labels, strict=True)
        )
        return Colouring(
            map_title(plane.plane), colours, every[0] - 0.5, every[-1] + 0.5, False, True, named + shades, reasons,
            reason_colours, names=_map_name_positions(variable, block, dict(zip(codes, labels, strict=True)), room),
        )  # fmt: skip
    low, high, note = colour_limits(shown, (float(norm.vmin or 0.0), float(norm.vmax or 0.0)), limits)
    if log:
        low, high, log, note = logarithmic_scale_limits(shown, low, high, note)
    if log and (hidden := (reasons == 0) & (values <= 0)).any():
        reason_colours += (to_hex(ZERO),)
        reasons[hidden] = len(reason_colours)
        shades += (LegendColour("zero or below", reason_colours[-1], float(hidden.sum() / reasons.size)),)
    palette = [to_hex(cmap(shade)) for shade in np.linspace(0.0, 1.0, SHADES)]
    beyond = _shares_beyond_limits(values[reasons == 0], low, high)
    sides = zip(beyond, ("below", "above"), strict=True)
    notes = [note, *(f"{share:.2%} of the values are {side} the scale" for share, side in sides if share)]
    note = "; ".join(each for each in notes if each)
    return Colouring(
        map_title(plane.plane), palette, low, high, log, False, shades, reasons, reason_colours, note,
        shares_beyond=beyond,
    )  # fmt: skip


def _map_name_positions(variable: str, block: MapBlock, labels: Mapping[float, str], room: Room) -> dict[str, Pair]:
    """Return the names of regions or of families, each with the point (δ, ε) where it is written; {} on other maps."""
    if variable == "region":
        return region_name_positions(block.values, block.delta, block.epsilon)
    return family_name_positions(block, labels, room) if variable == LARGEST else {}


def family_name_positions(block: MapBlock, labels: Mapping[float, str], room: Room) -> dict[str, Pair]:
    """Return {name of a family: point (δ, ε) where the name is written} of families that are wide enough on the map.

    A name that would overlap the name of a wider family is left out. room: pixels of the map along (delta, epsilon).

    Returns
    -------
    dict[str, Pair]
        Points by name, the widest family first.
    """
    rows, columns = block.values.shape
    least = max(LEAST_WIDTH * min(rows, columns), 1.5)
    large = [code for code in labels if 0 < code < OTHERS and (block.values == code).sum() > 3 * (least - 1) ** 2]
    named = {int(code): _short_family_name(labels[code]) for code in large}
    # width and height of a name, as shares of the map's width and height
    long, tall = (pixels / max(size, 1) for pixels, size in zip(NAME_SIZE, room, strict=True))
    places: dict[str, Pair] = {}
    taken: list[Pair] = []
    for code, (i, j, wide) in sorted(innermost_cells(block.values, named).items(), key=lambda each: -each[1][2]):
        # the name is moved inwards, so that none of its letters is cut off
        inside = int(np.clip(j, long / 2 * columns, max(1 - long / 2, long / 2) * columns - 1))
        at = i / rows, inside / columns
        is_free = all(abs(at[0] - y) > tall or abs(at[1] - x) > long for y, x in taken)
        if wide >= least and is_free and block.values[i, inside] == code:
            taken.append(at)
            places[named[code]] = float(block.delta[inside]), float(block.epsilon[i])
    return places


def _short_family_name(label: str) -> str:
    """Shorten the name of a family to its number and letter: "6: P(1,1,1) = D" to "6: D". Other names do not change."""
    number, is_numbered, name = label.partition(": ")
    return f"{number}: {name.split(' = ')[-1]}" if is_numbered else label


def _shares_beyond_limits(values: np.ndarray, low: float, high: float) -> Pair:
    """Return the share of values below `low` and the share above `high`, both rounded to float32 like the values."""
    if not values.size:
        return 0.0, 0.0
    least, most = np.float32(low), np.float32(high)
    return float((values < least).mean()), float((values > most).mean())
