"""How a map is coloured: the colours and words of map.png, with limits and a scale that the viewer may choose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.colors import to_hex

from service.explorer.common.address import Limits, Pair, Ranges
from service.explorer.map.planes import Block, Plane, Room
from workers.pictures.figure import region_places
from workers.pictures.look import limits_of, positive
from workers.pictures.maps import WITHOUT_VALUE, ZERO, scale_of, title_of, valueless_layers

SHADES = 256


@dataclass(frozen=True)
class Shade:
    """A colour of a map that stands for something, and the share of the computed cells that have it."""

    label: str
    colour: str
    share: float


@dataclass(frozen=True)
class Colouring:
    """Colours of a map.

    `reasons` (epsilon, delta), uint8, is 0 where a cell has a value and else the number of the colour of
    `reason_colours`. Codes run from `low` + 0.5; `log` says that colours are even in the logarithm.
    """

    title: str
    palette: Sequence[str]
    low: float
    high: float
    log: bool
    categorical: bool
    shades: tuple[Shade, ...]
    reasons: np.ndarray
    reason_colours: tuple[str, ...]
    note: str = ""
    names: Mapping[str, Pair] = field(default_factory=dict)  # of regions, and where they are written
    beyond: Pair = (0.0, 0.0)  # shares of the values below and above what colours span


def layers_of(plane: Plane, block: Block) -> dict[str, tuple[np.ndarray, str]]:
    """Which cells have no value, and the colour for each reason."""
    variable = str(plane.plane.name)
    return valueless_layers(variable, block.values, block.status, _nothing(plane))


def _nothing(plane: Plane) -> str:
    """What it means that a computed cell has no value."""
    return WITHOUT_VALUE.get(str(plane.plane.name), "none")


def _share(block: Block, code: int, shown: np.ndarray, computed: int) -> float:
    """Of the computed cells of the survey, also where several of them are drawn as one."""
    if block.shares:
        return block.shares.get(code, 0.0)
    return float((shown == code).sum() / max(computed, 1))


def values_shown(plane: Plane, block: Block) -> np.ndarray:
    """The values of a block; NaN where a cell has none."""
    without = np.logical_or.reduce([mask for mask, _ in layers_of(plane, block).values()])
    return np.where(without, np.float32(np.nan), block.values)


def window_shown(plane: Plane, window: Ranges, room: Room) -> tuple[np.ndarray, Ranges]:
    """The values of the cells of a window, and where these are. Blocks: for a thread."""
    block = plane.block(window, room)
    return values_shown(plane, block), block.box


def colouring(plane: Plane, block: Block, limits: Limits | Pair, log: bool) -> Colouring:
    """The colours of a map, of which this is drawn. Blocks: for a thread."""
    values, variable = block.values, str(plane.plane.name)
    layers = layers_of(plane, block)
    reasons = np.zeros(values.shape, np.uint8)
    for number, (mask, _) in enumerate(layers.values(), start=1):
        reasons[mask] = number
    shown = values[reasons == 0].astype(float)
    cmap, norm, codes, labels = scale_of(plane.plane, shown)
    computed = int((block.status != 0).sum())
    nothing = _nothing(plane)
    shades = tuple(
        Shade(label, colour, float((reasons == number).sum() / reasons.size))
        if block.without is None or label != nothing
        else Shade(label, colour, block.without)
        for number, (label, (_, colour)) in enumerate(layers.items(), start=1)
        if (reasons == number).any()
    )
    reason_colours = tuple(to_hex(colour) for _, colour in layers.values())
    shades = tuple(Shade(each.label, to_hex(each.colour), each.share) for each in shades)
    if codes is not None and labels:
        colours = [to_hex(cmap(norm(code))) for code in range(int(codes[0]), int(codes[-1]) + 1)]
        named = tuple(
            Shade(label, colours[int(code - codes[0])], _share(block, int(code), shown, computed))
            for code, label in zip(codes, labels, strict=True)
        )
        low, high = codes[0] - 0.5, codes[-1] + 0.5
        return Colouring(
            title_of(plane.plane), colours, low, high, False, True, named + shades, reasons, reason_colours,
            names=region_places(values, block.delta, block.epsilon) if variable == "region" else {},
        )  # fmt: skip
    low, high, note = limits_of(shown, (float(norm.vmin or 0.0), float(norm.vmax or 0.0)), limits)
    if log:
        low, high, log, note = positive(shown, low, high, note)
    if log and (hidden := (reasons == 0) & (values <= 0)).any():
        reason_colours += (to_hex(ZERO),)
        reasons[hidden] = len(reason_colours)
        shades += (Shade("zero or below", reason_colours[-1], float(hidden.sum() / reasons.size)),)
    palette = [to_hex(cmap(shade)) for shade in np.linspace(0.0, 1.0, SHADES)]
    beyond = _beyond(values[reasons == 0], low, high)
    sides = zip(beyond, ("below", "above"), strict=True)
    notes = [note, *(f"{share:.2%} of the values are {side} the scale" for share, side in sides if share)]
    note = "; ".join(each for each in notes if each)
    return Colouring(
        title_of(plane.plane), palette, low, high, log, False, shades, reasons, reason_colours, note, beyond=beyond
    )  # fmt: skip


def _beyond(values: np.ndarray, low: float, high: float) -> Pair:
    """Shares of values below and above limits; float32, as the values are, has less digits than limits have."""
    if not values.size:
        return 0.0, 0.0
    least, most = np.float32(low), np.float32(high)
    return float((values < least).mean()), float((values > most).mean())
