"""Draw a variable as a map over the (δ, ε) plane.

matplotlib's global state (pyplot) is not used, because servers draw in threads.
"""

import re
from collections.abc import Sequence
from io import BytesIO
from itertools import pairwise
from textwrap import wrap

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure

from gear_rattle.workers.errors import SurveyError, report_damage
from gear_rattle.workers.pictures.largest import FLAG_COLOURS
from gear_rattle.workers.pictures.levels import OpenGroup, choose_level_for_window, reduce_map
from gear_rattle.workers.pictures.look import (
    AMONG,
    COVERED,
    LARGEST,
    NO_OVERLAYS,
    POINTS,
    SHARE,
    USUAL_LOOK,
    WHICH,
    FinerCells,
    Form,
    MapPictureOptions,
    OverlayData,
    replace_periods_with_revolutions,
    variable_in_words,
)
from gear_rattle.workers.pictures.machine_axes import draw_machine_axes
from gear_rattle.workers.pictures.overlay import CURVES_ON, draw_codimension_two_points, draw_curves
from gear_rattle.workers.pictures.planes import SLOT_ORDER, UNJOINED, map_of_variable, mask_nonperiodic, values_to_draw
from gear_rattle.workers.survey.levels.grid import centres_of_level_cells, possible_levels
from gear_rattle.workers.survey.levels.reduce import pool_cells
from gear_rattle.workers.survey.request import BY_FAMILY, BY_FRACTION
from gear_rattle.workers.survey.slices import third_axis_value
from gear_rattle.workers.survey.values.evaluate import FAILED
from gear_rattle.workers.survey.values.quantities import QUANTITIES
from gear_rattle.workers.survey.values.schema import FIXED, OF_PERIODIC, SLOT, Group, is_phase
from rattle import KINDS
from rattle.orbits import PAPER_REGIONS
from rattle.plot import KIND_COLOURS, REGION_COLOURS, new_figure

ONLY_QUIET, EMPTY_SLOT = "only quiet", "empty slot"
NOT_COMPUTED, FAILURE, NOTHING, INFINITE, ZERO = "0.78", "#3b0a0a", "#eee3bd", "#f3f6f9", "#c9b2c2"
#: Words in the legend for computed cells without a value, by variable.
WITHOUT_VALUE = {
    "basin_entropy": "undecided",
    "boundary_basin_entropy": "no boundary, or undecided",
    "boundary_distance": "undecided",
    "boundary_distance_phase": "no such impact",
    "watched_periods": "all samples settled",
    "attractor_lyapunov": f"quiet, or {EMPTY_SLOT}",
    **dict.fromkeys(("lyapunov_max", "sum_rule_error", "impulse_balance_error"), ONLY_QUIET),
    **dict.fromkeys(OF_PERIODIC, "no periodic attractor in this slot"),
    **{
        each.name: f"undecided, or {EMPTY_SLOT}" if SLOT in each.dims else "undecided"
        for each in QUANTITIES
        if each.group is Group.INTENSITY
    },
}
#: {coordinate of a map: words in its legend for computed cells without a value}, for variables not in WITHOUT_VALUE.
WITHOUT_VALUE_OF = {SLOT: EMPTY_SLOT, "orbit": "no such orbit"}
#: Descriptions of a slot of attractors, by the rule that orders slots.
SLOTS = {
    BY_FRACTION: "attractor {} of each cell, by falling share",
    BY_FAMILY: "slot {}, by family: a cell's other attractors are in other slots",
    UNJOINED: "attractor {} of each cell, by falling share until families are joined",
}
AT_ZERO = {"boundary_distance": "no quiet motion"}
#: Unit of a variable, by a word in its name. The first of these words that the name contains gives the unit; a variable
#: whose name contains none of them has no unit.
UNITS = {
    "entropy": "nats",
    "level": "dB",
    "contact": "share of the time",
    "phase": "forcing periods",
    "fraction": "share of the sample",
    "energy": "v²/2, per forcing period",
    "impacts": "per forcing period",
    "lyapunov": "per forcing period",
    "speed": "per forcing period",
    "distance": "impact speed, per forcing period",
    "periods": "forcing periods",
}
FARTHEST_DRAWN = 1e300  # axes reach at most to this value, so that matplotlib's margins do not overflow
SIGNS = {"+": "₊", "-": "₋"}  # subscripts that name the walls Σ⁺ and Σ⁻
CAPTION_WIDTH = 110  # most characters in a line of the caption below a map
MOST_DRAWN_CELLS = (512, 512)  # along (epsilon, delta): fewer than a map has pixels, so that every cell is visible
SYMMETRIC = "symmetric"  # attribute of a map whose colours are centred at 0
CODE_COLOURS = ("#f4efe3", "#9ecae1", "#74c476", "#e6550d", "#756bb1", "#636363")
KIND, PERIODIC_COLOUR = "attractor_kind", "#2f6fb5"
#: Colours of the codes of KIND: quiet, chaotic and undecided motions have the colours that they have in all pictures.
COLOURS_OF_KINDS = tuple(
    KIND_COLOURS.get(kind, PERIODIC_COLOUR if kind == "periodic" else CODE_COLOURS[0]) for kind in KINDS
)


def render_map_picture(
    dataset: xr.Dataset,
    variable: str,
    index: int = 0,
    opened: OpenGroup | None = None,
    look: MapPictureOptions = USUAL_LOOK,
    form: Form = "png",
    over: OverlayData = NO_OVERLAYS,
) -> bytes:
    """Return the picture that `draw_map_figure` draws, with the same arguments, as the content of a file.

    Parameters
    ----------
    form : Form
        Format of the file, PNG, SVG or PDF.

    Returns
    -------
    bytes
        Content of the file.

    Raises
    ------
    SurveyError
        See `draw_map_figure`.
    """
    figure = draw_map_figure(dataset, variable, index, opened, look, over)
    with BytesIO() as file:
        figure.savefig(file, format=form)
        return file.getvalue()


def draw_map_figure(
    dataset: xr.Dataset,
    variable: str,
    index: int = 0,
    opened: OpenGroup | None = None,
    look: MapPictureOptions = USUAL_LOOK,
    over: OverlayData = NO_OVERLAYS,
) -> Figure:
    """Draw a variable of an open survey, finished or not.

    If there are more cells than pixels, several cells become one, which shows the rarest of their codes, or the mean of
    their numbers unless an extreme is rare (see `reduce_map`).

    Parameters
    ----------
    variable : str
        Any variable over (epsilon, delta).
    index : int
        The number of the map, from 0, if the variable has a map for each orbit or slot; else 0. If an attractor has two
        exponents or multipliers, the map shows the first.
    opened : OpenGroup | None
        Function that opens a pyramid level of the survey, which is faster than reading all cells; None: read all cells.
    look : MapPictureOptions
        Window, colours and lines; by default the usual ones. If `look.family` is set, the dataset must have the maps of
        families (`add_family_maps`).
    over : OverlayData
        Overlays that were computed beforehand.

    Returns
    -------
    Figure
        A matplotlib figure with map, colour bar, lines and legend.

    Raises
    ------
    SurveyError
        The survey has no such map, it cannot be read, or its axes reach too far to be drawn.
    """
    if look.delta or look.epsilon:
        dataset, opened = look.cut_to_window(dataset), None  # pyramid levels cover all cells, not a window
    shown = reduce_map(dataset, variable, index, MOST_DRAWN_CELLS, opened)
    plane = map_of_variable(shown, variable, index if shown is dataset else 0)
    with report_damage(f"the map of {variable}"):
        plane = mask_nonperiodic(shown, plane.load(), index) if shown is dataset else plane
        shown["status"].load()
    figure = new_figure(7.0, 5.2)
    axes = figure.add_subplot()
    draw_map(axes, shown, plane, look=look, finer=over.finer_cells)
    is_machine = draw_machine_axes(axes, dataset)
    if look.family is not None:
        _dim_cells_without_family(axes, dataset, look.family)
    third = "".join(f", {name} = {value:g}" for name, value in third_axis_value(dataset).items())
    axes.set_title(map_title(plane) + third, fontsize=11)
    if is_machine:
        axes.set_title(replace_periods_with_revolutions(axes.get_title()), fontsize=11)
        for each in figure.axes[1:]:  # all axes after the map's own, such as those of the colour bar
            each.set_ylabel(replace_periods_with_revolutions(each.get_ylabel()))
    usual = (*CURVES_ON.get(variable, ()), *([POINTS] if variable == "region" else []))
    lines = usual if look.lines is None else look.lines
    curves = draw_curves(axes, dataset, lines, over)
    draw_legend(axes)
    if POINTS in lines:
        draw_codimension_two_points(axes, dataset, curves)
    if look.caption:
        figure.supxlabel("\n".join(wrap(look.caption, CAPTION_WIDTH)), x=0.01, ha="left", fontsize=7, parse_math=False)
    return figure


def colour_bar_label(plane: xr.DataArray) -> str:
    """Return the label of a colour bar: the variable, with its unit if it has one."""
    name = variable_in_words(str(plane.name))
    unit = "" if "flag_meanings" in plane.attrs else next((UNITS[word] for word in UNITS if word in name), "")
    return f"{name}, {unit}" if unit else name


def readable_description(text: str) -> str:
    """Return a description from a store with subscripts and superscripts, such as P(m,n₊,n₋) for P(m, n+, n-)."""
    text = text.replace("P(m, n+, n-)", "P(m,n₊,n₋)").replace("Σ+", "Σ⁺").replace("Σ-", "Σ⁻")
    return re.sub(r"\b([nv]|Σv)([+-])(?![\w.])", lambda found: found[1] + SIGNS[found[2]], text)


def map_title(plane: xr.DataArray) -> str:
    """Return the title of a map: the variable's meaning, and its orbit or slot."""
    name = readable_description(str(plane.attrs.get("long_name", plane.name)))
    if np.iscomplexobj(plane):
        name = f"|{name}|"
    along = (dim for dim, value in plane.coords.items() if not value.dims and dim not in FIXED)
    chosen = ", ".join(_orbit_or_slot_in_words(str(dim), plane.coords[dim].item(), plane) for dim in along)
    return f"{name} ({chosen})" if chosen else name


def _orbit_or_slot_in_words(dim: str, value: object, plane: xr.DataArray) -> str:
    """Return words for one of a variable's maps: the orbit, or the slot of attractors, that it shows."""
    if dim != SLOT:
        return f"{dim} {value}"
    return SLOTS[plane.attrs.get(SLOT_ORDER, BY_FRACTION)].format(value)


#: Words of the legend for cells with an infinite value, by variable; a level without impacts is −∞ dB.
INFINITE_VALUE = {each.name: "quiet: no impacts" for each in QUANTITIES if each.name.endswith("_level")}


def words_for_missing_value(plane: xr.DataArray) -> str:
    """Return the words with which the legend explains computed cells that have no value."""
    words = (words for dim, words in WITHOUT_VALUE_OF.items() if dim in plane.coords)
    return WITHOUT_VALUE.get(str(plane.name)) or next(words, "no value")


def meanings_of_codes(plane: xr.DataArray) -> list[str]:
    """Return the meaning of each code of a map in words."""
    meanings = [each.replace("_", " ") for each in plane.attrs["flag_meanings"].split()]
    if plane.name == LARGEST:
        meanings[0] = ONLY_QUIET if plane.coords[AMONG] == WHICH[1] else "undecided"
    elif SLOT in plane.coords:
        meanings[0] = EMPTY_SLOT
    return meanings


def draw_map(
    axes: Axes,
    dataset: xr.Dataset,
    plane: xr.DataArray,
    nothing: str = "",
    look: MapPictureOptions = USUAL_LOOK,
    finer: FinerCells | None = None,
) -> None:
    """Draw a map with its colour bar.

    The colour of a cell without a value says whether it is not computed, failed, or has no value although it is
    computed.

    Parameters
    ----------
    nothing : str
        Words in the legend for computed cells without a value; "": the words of `words_for_missing_value(plane)`.
    look : MapPictureOptions
        Window, and range of the colours.
    finer : FinerCells | None
        Cells of finer resolution to draw over the survey's cells.

    Raises
    ------
    SurveyError
        The axes reach too far to be drawn.
    """
    reach = max(float(np.abs(dataset[axis].values).max()) for axis in ("delta", "epsilon"))
    if reach > FARTHEST_DRAWN:
        raise SurveyError(
            f"the axes reach {reach:g}, which cannot be drawn: axes may reach at most {FARTHEST_DRAWN:g}. Read the "
            "survey's numbers with open_survey"
        )
    values = values_to_draw(plane)
    layers = valueless_layers(
        str(plane.name), values, np.asarray(dataset["status"]), nothing or words_for_missing_value(plane)
    )
    valueless = np.logical_or.reduce([mask for mask, _ in layers.values()])
    for mask, colour in layers.values():
        _draw_cells(axes, dataset, np.where(mask, 1.0, np.nan), ListedColormap([colour]), Normalize(0, 1))
    seen = values[~valueless]
    if finer is not None:
        seen = np.append(seen, finer.values[np.isfinite(finer.values)])
    cmap, norm, ticks, labels = colour_scale_of(plane, seen)
    if not labels and (look.log or look.span != "auto"):
        norm = look.colour_norm(norm, seen)
    if isinstance(norm, LogNorm) and (hidden := ~valueless & (values <= 0)).any():
        layers["zero or below"] = hidden, ZERO
        valueless = valueless | hidden
        _draw_cells(axes, dataset, np.where(hidden, 1.0, np.nan), ListedColormap([ZERO]), Normalize(0, 1))
    extend = _exceeded_colour_bar_ends(norm, seen[seen > 0] if isinstance(norm, LogNorm) else seen)
    mesh = _draw_cells(axes, dataset, np.where(valueless, np.nan, values), cmap, norm)
    if finer is not None:
        shown = finer.values if not isinstance(norm, LogNorm) else np.where(finer.values > 0, finer.values, np.nan)
        _draw_cells(axes, finer, shown, cmap, norm)
    # These axes have a figure, although the type of `get_figure` allows None.
    bar = axes.get_figure().colorbar(mesh, ax=axes, ticks=ticks, pad=0.02, extend=extend)  # type: ignore[union-attr]
    bar.set_label(colour_bar_label(plane))
    if labels:
        bar.ax.set_yticklabels(labels)
        bar.minorticks_off()
        bar.ax.tick_params(length=0)
    for label, (mask, colour) in layers.items():
        if mask.any():
            axes.plot([], [], "s", color=colour, markeredgecolor="0.4", label=label)
    axes.set_xlabel("damping δ")
    axes.set_ylabel("eccentricity ε")
    if look.delta:
        axes.set_xlim(look.delta)
    if look.epsilon:
        axes.set_ylim(look.epsilon)


def valueless_layers(
    variable: str, values: np.ndarray, status: np.ndarray, nothing: str
) -> dict[str, tuple[np.ndarray, str]]:
    """Return {reason: (flags of the cells, colour)} for the cells that the colour bar does not explain.

    The reasons are words: the cell is not computed; it failed; its value is missing; its value is infinite; or, for a
    variable in AT_ZERO, its value is 0. nothing: the words for computed cells without a value.

    Returns
    -------
    dict[str, tuple[np.ndarray, str]]
        A layer for each reason, even if no cell has it.
    """
    layers = {
        "not computed": (status == 0, NOT_COMPUTED),
        "failed": (status == FAILED, FAILURE),
        nothing: ((status > 0) & (status != FAILED) & np.isnan(values), NOTHING),
        INFINITE_VALUE.get(variable, "infinite"): (np.isinf(values), INFINITE),
    }
    if variable in AT_ZERO:
        layers[AT_ZERO[variable]] = ((status > 0) & (values == 0), ZERO)
    return layers


def draw_legend(axes: Axes) -> None:
    """Draw a legend below the map, if there are lines, or colours that the colour bar does not explain."""
    if axes.get_legend_handles_labels()[1]:
        axes.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=5, columnspacing=1.2, fontsize=8, frameon=False
        )


def _dim_cells_without_family(axes: Axes, dataset: xr.Dataset, family: int) -> None:
    """Dim the cells that lack the family `family`; in a reduced map, the cells that cover no cell with this family."""
    share = map_of_variable(dataset, SHARE, family)
    with report_damage(f"the map of {SHARE}"):
        values = values_to_draw(share)
    shape = values.shape[0], values.shape[1]
    level = choose_level_for_window(possible_levels(shape), (0, 0), shape, MOST_DRAWN_CELLS).level
    along, across = level.covered_cells if level else (1, 1)
    shown = FinerCells(
        centres_of_level_cells(dataset["delta"].values, across),
        centres_of_level_cells(dataset["epsilon"].values, along),
        pool_cells(np.nan_to_num(values), (along, across), np.maximum),
    )
    others = np.where(shown.values > 0, np.nan, 1.0)
    _draw_cells(axes, shown, others, ListedColormap(["white"]), Normalize(0, 1)).set_alpha(COVERED)


def _draw_cells(
    axes: Axes, at: xr.Dataset | FinerCells, values: np.ndarray, cmap: Colormap, norm: Normalize
) -> QuadMesh:
    delta, epsilon = (
        (at.delta, at.epsilon) if isinstance(at, FinerCells) else (at["delta"].values, at["epsilon"].values)
    )
    # The map is rasterised, because a vector file would have a path for each cell.
    return axes.pcolormesh(
        delta, epsilon, np.ma.masked_invalid(values), cmap=cmap, norm=norm, shading="nearest", rasterized=True
    )


def _exceeded_colour_bar_ends(norm: Normalize, values: np.ndarray) -> str:
    """Return at which ends values exceed the colour bar: matplotlib's "both", "min", "max" or "neither"."""
    low, high = bool(np.any(values < norm.vmin)), bool(np.any(values > norm.vmax))
    return {(True, True): "both", (True, False): "min", (False, True): "max"}.get((low, high), "neither")


def _is_code_in_colour_bar(plane: xr.DataArray, code: int, values: np.ndarray) -> bool:
    """Return whether the colour bar lists the region, family or motion with this code.

    Families, and regions that the paper does not name, are listed only if they occur among the values.

    Returns
    -------
    bool
        True if the code is listed.
    """
    always = code <= len(PAPER_REGIONS) if plane.name == "region" else plane.name != LARGEST
    return always or bool((values == code).any())


def colours_of_codes(plane: xr.DataArray) -> Sequence[str]:
    """Return the colour of each code of a map of codes."""
    own = str(plane.attrs.get(FLAG_COLOURS, "")).split()
    # On the map of the families other than quiet running, code 0 (no such family) means only quiet running.
    if plane.name == LARGEST and plane.coords[AMONG] == WHICH[1]:
        own[0] = KIND_COLOURS["quiet"]
    return own or {"region": REGION_COLOURS, KIND: COLOURS_OF_KINDS}.get(str(plane.name), CODE_COLOURS)


def colour_scale_of(
    plane: xr.DataArray, values: np.ndarray
) -> tuple[Colormap, Normalize, Sequence[float] | None, list[str]]:
    """Return colour map, norm, ticks (None: matplotlib's) and tick labels for a map with these finite values."""
    if "flag_meanings" in plane.attrs:
        meanings = meanings_of_codes(plane)
        colours = colours_of_codes(plane)
        first = 0 if (values == 0).any() else 1
        codes = [code for code in range(first, len(meanings)) if _is_code_in_colour_bar(plane, code, values)] or [first]
        cmap = ListedColormap([colours[code] for code in codes])
        between = [(low + high) / 2 for low, high in pairwise(codes)]
        norm = BoundaryNorm([codes[0] - 0.5, *between, codes[-1] + 0.5], cmap.N)
        return cmap, norm, codes, [meanings[code] for code in codes]
    if plane.dtype == bool:
        return (
            ListedColormap([CODE_COLOURS[0], CODE_COLOURS[1]]),
            BoundaryNorm([-0.5, 0.5, 1.5], 2),
            [0, 1],
            ["no", "yes"],
        )
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    if is_phase(str(plane.name)):
        return colormaps["twilight_shifted"], Normalize(0, 1), None, []
    if str(plane.name).endswith("_fraction"):
        return colormaps["viridis"], Normalize(0, 1), None, []
    if np.issubdtype(plane.dtype, np.integer) and values.size:
        # The largest 2 % of the values share one colour. On a scale up to rare long periods, most would look alike.
        high = max(float(np.quantile(values, 0.98)), low + 1)
    if "lyapunov" in str(plane.name) or plane.attrs.get(SYMMETRIC):
        # The 2 % of the values with the largest magnitudes share the end colours. On a scale up to the exponents near
        # the quiet limit, most values would look alike.
        reach = float(np.quantile(np.abs(values), 0.98)) if values.size else 1.0
        reach = reach or float(np.abs(values).max(initial=0.0)) or 1.0
        return colormaps["RdBu_r"], Normalize(-reach, reach), None, []
    return colormaps["viridis"], Normalize(low, high if high > low else low + 1), None, []
