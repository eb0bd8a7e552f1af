"""Draw lines over a map, and list the lines in a key, which also says why a line is missing."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np
import panel as pn

from gear_rattle.service.explorer.common.address import FEW_LINES, OVERLAYS, UNCHOSEN, Pair, Ranges
from gear_rattle.service.explorer.common.glyphs import line_style_of
from gear_rattle.service.explorer.common.lists import MapLegend
from gear_rattle.service.explorer.common.viewer import PageSession
from gear_rattle.service.explorer.common.watch import WidgetWatcher
from gear_rattle.service.explorer.files import help_table_rows
from gear_rattle.service.explorer.map.colouring import LegendColour
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.state.events import OverlaysChosen, RequiredShareSet
from gear_rattle.service.explorer.state.store import JOBS, PageStore, window_of_request
from gear_rattle.service.operations.overlaid import Overlays, design_limit_band, design_limit_line
from gear_rattle.workers.pictures.look import CRISIS, LIMIT, POINTS, USUAL_SHARE
from gear_rattle.workers.survey.axes import Window
from gear_rattle.workers.survey.plane_curves import LOWEST_DELTA, MissingCurve, trace_curve_in_window
from rattle import RattleError
from rattle.models import DEFAULT_MODEL, Capability, Model, missing_capability_error
from rattle.plot import polyline
from rattle.populations import MOST_SHARE

LABELS = {"quiet_limit": "quiet limit", CRISIS: "crisis: chaos ends", LIMIT: "design limit", POINTS: "COD20–23"}
LINES_OF_ALL_WINDOWS = frozenset({CRISIS, LIMIT})  # lines that are computed once for all windows


class MapLines:
    """Lines over a map: curves and points of a model, each computed by a task of its own."""

    def __init__(self, viewer: PageSession, figure: MapFigure) -> None:
        self._viewer, self._figure = viewer, figure
        self._common_dependencies: tuple[Hashable, ...] = ()  # model, and the other values on which all lines depend
        self._tasks: dict[str, tuple[Hashable, asyncio.Task[None]]] = {}

    def draw(self, names: Sequence[str], model: Model, window: Ranges, *dependencies: Hashable) -> None:
        """Draw the named lines in a window, unless they are drawn or being computed, and hide all other lines.

        Parameters
        ----------
        dependencies : Hashable
            Further values on which all lines depend, such as the id of the survey. If such a value or the model has
            changed since the last call, all lines are removed first.
        """
        if self._common_dependencies != (model, *dependencies):
            self.clear()
            self._common_dependencies = model, *dependencies
        self._figure.show_overlays(names)
        for name in names:
            if _is_offered(name, model):
                asked = self._dependencies_of(name, window)
                if name in self._tasks:
                    known, task = self._tasks[name]
                    if known == asked:
                        continue
                    task.cancel()
                self._tasks[name] = asked, self._viewer.start(self._compute_line(name, model, window))

    def _dependencies_of(self, name: str, window: Ranges) -> Hashable:  # noqa: ARG002 - in a subclass it decides
        """Return the values, besides the model, on which a line depends. If they change, the line is computed again."""
        return window

    def clear(self) -> None:
        """Remove all lines, and cancel their computations."""
        while self._tasks:
            self._tasks.popitem()[1][1].cancel()
        self._common_dependencies = ()
        self._figure.remove_lines()

    def _change_lines(self, name: str, change: Callable[[], object]) -> None:
        """Let the page call `change` to draw a line that the current task has computed.

        The page does not call `change` if another task has begun to compute the line meanwhile.
        """
        task = asyncio.current_task()

        def change_unless_cancelled() -> None:
            if name in self._tasks and self._tasks[name][1] is task:
                change()

        self._viewer.schedule_document_change(change_unless_cancelled)

    async def _compute_line(self, name: str, model: Model, window: Ranges) -> None:
        await self._viewer.front.kernels.wait_until_compiled(model.name, patience=math.inf)
        if name == POINTS:
            points = await self._viewer.run_in_thread(lambda: codimension_two_points_in_window(model, window))
            self._change_lines(name, lambda: self._figure.mark_points(points))
        elif name in model.curve_names:
            pieces, missing = await self._viewer.run_in_thread(lambda: curve_pieces(name, model, *window))
            self._change_lines(name, lambda: self._figure.draw_line(name, pieces))
            self._write_note_in_key(name, "", missing)
        else:
            self._write_note_in_key(name, "", _missing_curves_message(model))

    def _write_note_in_key(self, name: str, note: str, missing: str = "") -> None:
        """Write in the key the progress of a line (`note`), or why the line is missing. Without a key, do nothing."""


class MapLinesWithKey(MapLines):
    """Lines over the first map, with a key. panel: the key, in which a viewer chooses lines."""

    def __init__(
        self, overlaid: Overlays, viewer: PageSession, store: PageStore, figure: MapFigure, sheet: str
    ) -> None:
        super().__init__(viewer, figure)
        self._overlaid, self._store = overlaid, store
        self._listed: tuple[Hashable, ...] = ()
        self._listing: asyncio.Task[None] | None = None
        self._entries: list[dict[str, Any]] = []
        view = store.view
        self.key = MapLegend(overlays=[], chosen=list(view.lines), margin=0, sizing_mode="stretch_width")
        self._watch = WidgetWatcher()
        self._watch.call_on_change(self.key, self._on_lines_chosen, "chosen")
        self.share = pn.widgets.FloatInput(
            label="Design limit: P(quiet) ≥", value=view.share, start=0.01, end=MOST_SHARE, step=0.05, width=180,
            visible=LIMIT in view.lines, stylesheets=[sheet], margin=(4, 0),
        )  # fmt: skip
        self._watch.call_on_change(self.share, self._on_share)
        self.panel = pn.Column(self.key, self.share, sizing_mode="stretch_width", margin=0)
        self._list_lines()
        figure.show_overlays(view.lines)
        store.subscribe(self._list_lines, "survey", "slice", JOBS)
        store.subscribe(
            self._on_view_change,
            "survey", "slice", JOBS, "variable", "overlays", "share", "delta", "epsilon", "seen",
        )  # fmt: skip

    def _on_lines_chosen(self) -> None:
        chosen = tuple(name for name in OVERLAYS if name in self.key.chosen)
        # if the page has set the choice, the browser only reports it back: it equals the view's lines
        if chosen != self._store.view.lines:
            self._store.dispatch(OverlaysChosen(chosen))

    def _on_share(self) -> None:
        self._store.dispatch(RequiredShareSet(float(self.share.value or USUAL_SHARE)))

    def show_legend_colours(self, shades: Sequence[LegendColour]) -> None:
        """Show in the key the meaning of each colour and the share of the cells that have the colour."""
        self.key.shades = [{"label": each.label, "colour": each.colour, "share": each.share} for each in shades]

    def _list_lines(self) -> None:
        """List the lines of the survey's model in the key.

        For the survey of a machine, start a task that removes from the key the lines outside the survey's plane.
        """
        request, model = self._store.request, self._store.model
        window = None if request is None or request.machine is None else window_of_request(request)
        if (listed := (model, window)) == self._listed:
            return
        self._listed, self._entries = listed, legend_entries_of_map(model)
        self.key.overlays = self._entries
        if self._listing is not None:
            self._listing.cancel()
        self._listing = None if window is None else self._viewer.start(self._list_present_lines(model, window))

    async def _list_present_lines(self, model: Model, window: Ranges) -> None:
        await self._viewer.front.kernels.wait_until_compiled(model.name, patience=math.inf)
        absent = await self._viewer.run_in_thread(lambda: names_of_absent_lines(model, window))
        self._entries = found = [each for each in self._entries if each["name"] not in absent]
        self._viewer.schedule_document_change(lambda: self.key.param.update(overlays=found))

    def _on_view_change(self) -> None:
        view = self._store.view
        with self._watch.ignore_changes():
            self.key.chosen = list(view.lines)
        self.share.visible = LIMIT in view.lines
        if self._store.request is None or view.seen is None:
            self.clear()
        else:
            self.draw(view.lines, self._store.model, self._store.window, view.survey)

    def _dependencies_of(self, name: str, window: Ranges) -> Hashable:
        if name == LIMIT:
            return self._delta_range, self._store.view.share
        return None if name in LINES_OF_ALL_WINDOWS else window

    @property
    def _delta_range(self) -> Pair:
        """Range of damping of the survey, over which the design limit is computed."""
        whole = self._store.survey_request_with_all_slices
        return UNCHOSEN[0] if whole is None else (whole.delta.start, whole.delta.stop)

    async def _compute_line(self, name: str, model: Model, window: Ranges) -> None:
        if name not in LINES_OF_ALL_WINDOWS:
            await super()._compute_line(name, model, window)
            return
        await self._viewer.front.kernels.wait_until_compiled(model.name, patience=math.inf)
        self._write_note_in_key(name, "is being computed …")
        try:
            if name == CRISIS:
                pieces = [await self._overlaid.crises.crisis_curve_of(model)]
                self._change_lines(name, lambda: self._figure.draw_line(name, pieces))
            else:
                async for delta, limits in self._overlaid.limits.limits_over_damping(
                    model, self._delta_range, self._store.view.share
                ):
                    self._change_lines(name, partial(self._show_design_limit, delta, limits))
        except RattleError as error:
            self._write_note_in_key(name, "", str(error))
        else:
            self._write_note_in_key(name, "")

    def _show_design_limit(self, delta: np.ndarray, limits: np.ndarray) -> None:
        self._figure.draw_line(LIMIT, split_at_nan(design_limit_line(delta, limits)))
        self._figure.draw_limit_band(*design_limit_band(delta, limits))

    def _write_note_in_key(self, name: str, note: str, missing: str = "") -> None:
        entries = [
            each | {"note": note, "missing": bool(missing), "meaning": missing or each["meaning"]}
            if each["name"] == name
            else each
            for each in self._entries
        ]
        if entries != self._entries:
            self._entries = entries
            self._viewer.schedule_document_change(lambda: self.key.param.update(overlays=entries))


def legend_entries_of_map(model: Model) -> list[dict[str, Any]]:
    """Return the entries of the key: the lines and the marks that a map of a model can show."""
    return [
        {
            "name": name,
            "label": LABELS.get(name, name),
            "meaning": _line_meaning(name, model),
            "colour": line_style_of(name)[0] if name != POINTS else "",
            "dash": list(line_style_of(name)[1]) if name != POINTS else [],
            "note": "",
            "missing": False,
        }
        for name in OVERLAYS
        if _is_offered(name, model)
    ]


#: Capability that a model must have for a line.
NEEDED_CAPABILITY = {CRISIS: Capability.CRISIS, POINTS: Capability.CORNERS}


def _is_offered(name: str, model: Model) -> bool:
    return name not in NEEDED_CAPABILITY or NEEDED_CAPABILITY[name] in model.has


def _line_meaning(name: str, model: Model) -> str:
    """Return the meaning of a line for its entry in the key: a sentence of the help, for most lines.

    For a curve of a model other than the default one, the meaning is that model's description of the curve, or the
    message that the model has no such curves.

    Returns
    -------
    str
        The meaning.
    """
    if name == POINTS:
        return "; ".join(f"{point}: {what}" for point, what in help_table_rows("Points where lines meet").items())
    if name in (CRISIS, LIMIT) or model.name == DEFAULT_MODEL:
        return help_table_rows("The lines")[LABELS.get(name, name)]
    return model.describe(name) if name in model.curve_names else _missing_curves_message(model)


def _missing_curves_message(model: Model) -> str:
    return str(missing_capability_error(Capability.CORNERS, model))


def curve_pieces(name: str, model: Model, delta: Pair, epsilon: Pair) -> tuple[list[np.ndarray], str]:
    """Return the pieces of a curve inside a window, each an array (k, 2) of points (δ, ε), or why it is not traced.

    This function blocks: use a thread. A curve that lies outside of the window has no pieces and no reason.

    Returns
    -------
    tuple[list[np.ndarray], str]
        Pieces, and the reason why the curve cannot be traced; "" if it could be traced.
    """
    if name not in model.curve_names:
        return [], _missing_curves_message(model)
    window = Window((max(delta[0], LOWEST_DELTA * delta[1]), delta[1]), (max(epsilon[0], 0.0), max(epsilon[1], 0.0)))
    if window.epsilon[0] >= window.epsilon[1]:
        return [], ""
    curve = trace_curve_in_window(name, model, window)
    if isinstance(curve, MissingCurve):
        return [], curve.reason
    return split_at_nan(polyline(curve)) if len(curve) else [], ""


def names_of_absent_lines(model: Model, window: Ranges) -> set[str]:
    """Return the names of a model's lines and points that a window lacks. This function blocks: use a thread."""
    curves = {name for name in OVERLAYS if name in model.curve_names and curve_pieces(name, model, *window) == ([], "")}
    return (
        curves
        if not _is_offered(POINTS, model) or codimension_two_points_in_window(model, window)
        else curves | {POINTS}
    )


def cache_default_lines(model: Model, window: Ranges) -> None:
    """Compute the default lines of a page, so that they are cached. This function blocks: use a thread."""
    for name in FEW_LINES:
        if name != POINTS:
            curve_pieces(name, model, *window)
        elif _is_offered(name, model):
            codimension_two_points_in_window(model, window)


def split_at_nan(line: np.ndarray) -> list[np.ndarray]:
    """Return the pieces of a line (k, 2) that has rows of NaN between its pieces."""
    gaps = np.flatnonzero(np.isnan(line[:, 0]))
    return [piece[~np.isnan(piece[:, 0])] for piece in np.split(line, gaps)]


def codimension_two_points_in_window(model: Model, window: Ranges) -> list[tuple[str, float, float]]:
    """Return (name, δ, ε) of each codimension-two point in a window.

    This function blocks: use a thread. Points outside are left out, because their names would reach into the window.

    Returns
    -------
    list[tuple[str, float, float]]
        Name, δ and ε of each point.
    """
    (left, right), (bottom, top) = window
    return [
        (point.name, point.delta, point.epsilon)
        for point in _codimension_two_points(model)
        if left <= point.delta <= right and bottom <= point.epsilon <= top
    ]


@lru_cache(maxsize=64)
def _codimension_two_points(model: Model) -> Sequence[Any]:
    with np.errstate(all="ignore"):
        return model.codimension_two()
