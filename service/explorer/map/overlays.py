"""The lines over a map and their key. Each line is found by a task of its own, and the key tells what is missing."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np
import panel as pn

from gear_rattle.service.explorer.common.address import DEFAULT_OVERLAYS, OVERLAYS, Pair, Ranges
from gear_rattle.service.explorer.common.changes import in_event_loop
from gear_rattle.service.explorer.common.glyphs import style_of
from gear_rattle.service.explorer.common.lists import Key
from gear_rattle.service.explorer.common.viewer import Viewer
from gear_rattle.service.explorer.common.watch import Watch
from gear_rattle.service.explorer.map.colouring import Shade
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.operations.overlaid import Overlaid, limit_band, limit_line
from gear_rattle.workers.pictures.look import CRISIS, LIMIT, POINTS, USUAL_SHARE
from gear_rattle.workers.survey.axes import Window
from gear_rattle.workers.survey.curves import LOWEST_DELTA, Missing, traced_curve
from rattle import RattleError
from rattle.models import Capability, Model, lacking
from rattle.plot import polyline
from rattle.populations import MOST_SHARE

MEANINGS = {
    CRISIS: "boundary crisis: the chaotic attractor ends where it touches the stable manifold of the saddle A",
    LIMIT: "design limit: up to there, and at every smaller eccentricity, a gear started at any phase and natural "
    "speed runs quietly often enough; its 95 % interval is shaded",
    POINTS: "codimension-two points, where curves meet",
}
LABELS = {"quiet_limit": "quiet limit", LIMIT: "design limit", POINTS: "COD20–23"}
WHOLE = frozenset({CRISIS, LIMIT})  # lines that no window changes


class MapLines:
    """The lines that may be drawn on a map.

    `on_chosen` is called when the viewer switches some on or off, or asks for another design limit.
    """

    def __init__(
        self,
        overlaid: Overlaid,
        viewer: Viewer,
        canvas: MapFigure,
        chosen: Sequence[str],
        share: float,
        on_chosen: Callable[[], None],
        on_share: Callable[[float], None],
        sheet: str,
    ) -> None:
        self._overlaid, self._viewer, self._map = overlaid, viewer, canvas
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._entries: list[dict[str, Any]] = []
        self.key = Key(overlays=self._entries, chosen=list(chosen), margin=0, sizing_mode="stretch_width")
        self.key.param.watch(in_event_loop(lambda _event: on_chosen()), "chosen")
        self._share = pn.widgets.FloatInput(
            label="Design limit: P(quiet) ≥", value=share, start=0.01, end=MOST_SHARE, step=0.05, width=180,
            visible=LIMIT in chosen, stylesheets=[sheet], margin=(4, 0),
        )  # fmt: skip
        Watch().on(self._share, lambda: on_share(self.share))
        self.key.param.watch(lambda _event: self._share.param.update(visible=LIMIT in self.chosen), "chosen")
        self.panel = pn.Column(self.key, self._share, sizing_mode="stretch_width", margin=0)
        self._span: Pair = 0.4, 1.0
        self._counting: asyncio.Task[None] | None = None
        self._listing: asyncio.Task[None] | None = None
        canvas.choose(tuple(chosen))

    @property
    def share(self) -> float:
        """The least P(quiet) of the design limit."""
        return float(self._share.value or USUAL_SHARE)

    @property
    def chosen(self) -> tuple[str, ...]:
        """The lines that are switched on, in the order of the key."""
        return tuple(name for name in OVERLAYS if name in self.key.chosen)

    def show(self, shades: Sequence[Shade]) -> None:
        """Show in the key what colours mean, with these shares."""
        if self._counting is not None:
            self._counting.cancel()
        self._shade(shades)

    def count(self, shades: Callable[[], Sequence[Shade]]) -> None:
        """Show what is counted in a thread."""
        if self._counting is not None:
            self._counting.cancel()
        self._counting = self._viewer.start(self._counted(shades))

    async def _counted(self, shades: Callable[[], Sequence[Shade]]) -> None:
        found = await self._viewer.read(shades)
        self._viewer.change(lambda: self._shade(found))

    def _shade(self, shades: Sequence[Shade]) -> None:
        self.key.shades = [{"label": each.label, "colour": each.colour, "share": each.share} for each in shades]

    def tell(self, model: Model, span: Pair, window: Ranges | None = None) -> None:
        """List the lines of this model in the key; the survey spans these dampings.

        Parameters
        ----------
        window : Ranges | None
            List only curves and points inside of it, once these are known; None for all of the model.
        """
        self._entries, self._span = entries(model), span
        self.key.overlays = self._entries
        if self._listing is not None:
            self._listing.cancel()
        self._listing = None if window is None else self._viewer.start(self._list_present(model, window))

    async def _list_present(self, model: Model, window: Ranges) -> None:
        await self._viewer.front.kernels.require(model.name, patience=math.inf)
        absent = await self._viewer.read(lambda: absent_lines(model, window))
        self._entries = found = [each for each in self._entries if each["name"] not in absent]
        self._viewer.change(lambda: self.key.param.update(overlays=found))

    def draw(self, names: Sequence[str], model: Model, window: Ranges) -> None:
        """Find some lines of a model in a window, instead of what was being found of them."""
        for name in names:
            if name in self._tasks:
                self._tasks.pop(name).cancel()
            if not _is_offered(name, model):
                continue
            self._tasks[name] = self._viewer.start(self._line(name, model, window))

    def clear(self) -> None:
        """Show no lines, and find none."""
        while self._tasks:
            self._tasks.popitem()[1].cancel()
        self._map.no_lines()

    async def _line(self, name: str, model: Model, window: Ranges) -> None:
        await self._viewer.front.kernels.require(model.name, patience=math.inf)
        if name == POINTS:
            points = await self._viewer.read(lambda: points_in(model, window))
            self._viewer.change(lambda: self._map.points(points))
            return
        if name == LIMIT:
            await self._limit(model)
            return
        if name == CRISIS:
            self._note(name, "is being computed …")
            try:
                pieces, missing = [await self._overlaid.crises.of(model)], ""
            except RattleError as error:
                pieces, missing = [], str(error)
        else:
            pieces, missing = await self._viewer.read(lambda: pieces_of(name, model, *window))
        self._note(name, "", missing)
        self._viewer.change(lambda: self._map.line(name, pieces))

    async def _limit(self, model: Model) -> None:
        missing = ""
        self._note(LIMIT, "is being computed …")
        try:
            async for delta, limits in self._overlaid.limits.along(model, self._span, self.share):
                self._viewer.change(partial(self._show_limit, delta, limits))
        except RattleError as error:
            missing = str(error)
        self._note(LIMIT, "", missing)

    def _show_limit(self, delta: np.ndarray, limits: np.ndarray) -> None:
        self._map.line(LIMIT, split(limit_line(delta, limits)))
        self._map.band(*limit_band(delta, limits))

    def _note(self, name: str, note: str, missing: str = "") -> None:
        entries = [
            each | {"note": note, "missing": bool(missing), "meaning": missing or each["meaning"]}
            if each["name"] == name
            else each
            for each in self._entries
        ]
        if entries != self._entries:
            self._entries = entries
            self._viewer.change(lambda: self.key.param.update(overlays=entries))


def entries(model: Model) -> list[dict[str, Any]]:
    """Return the overlays as the key of a map of this model lists them."""
    return [
        {
            "name": name,
            "label": LABELS.get(name, name),
            "meaning": _meaning(name, model),
            "colour": style_of(name)[0] if name != POINTS else "",
            "dash": list(style_of(name)[1]) if name != POINTS else [],
            "note": "",
            "missing": False,
        }
        for name in OVERLAYS
        if _is_offered(name, model)
    ]


#: What a model must have for a line.
NEEDS = {CRISIS: Capability.CRISIS, POINTS: Capability.CORNERS}


def _is_offered(name: str, model: Model) -> bool:
    return name not in NEEDS or NEEDS[name] in model.has


def _meaning(name: str, model: Model) -> str:
    if name in MEANINGS:
        return MEANINGS[name]
    return model.describe(name) if name in model.curve_names else _not_of(model)


def _not_of(model: Model) -> str:
    return str(lacking(Capability.CORNERS, model))


def pieces_of(name: str, model: Model, delta: Pair, epsilon: Pair) -> tuple[list[np.ndarray], str]:
    """Return the pieces (k, 2) of a curve inside a window, and why there are none if it cannot be traced.

    For a thread.

    Returns
    -------
    tuple[list[np.ndarray], str]
        Pieces, and the reason.
    """
    if name not in model.curve_names:
        return [], _not_of(model)
    window = Window((max(delta[0], LOWEST_DELTA * delta[1]), delta[1]), (max(epsilon[0], 0.0), max(epsilon[1], 0.0)))
    if window.epsilon[0] >= window.epsilon[1]:
        return [], ""
    curve = traced_curve(name, model, window)
    if isinstance(curve, Missing):
        return [], curve.reason
    return split(polyline(curve)) if len(curve) else [], ""


def absent_lines(model: Model, window: Ranges) -> set[str]:
    """Return the curves of a model that are not inside a window, and the points' name if no point is. For a thread."""
    curves = {name for name in OVERLAYS if name in model.curve_names and pieces_of(name, model, *window) == ([], "")}
    return curves if not _is_offered(POINTS, model) or points_in(model, window) else curves | {POINTS}


def usual_lines(model: Model, window: Ranges) -> None:
    """Find the lines that a page shows which asks for no others: they are kept. For a thread."""
    for name in DEFAULT_OVERLAYS:
        if name != POINTS:
            pieces_of(name, model, *window)
        elif _is_offered(name, model):
            points_in(model, window)


def split(line: np.ndarray) -> list[np.ndarray]:
    """Return a line (k, 2) with NaN between its pieces, as a list of the pieces."""
    gaps = np.flatnonzero(np.isnan(line[:, 0]))
    return [piece[~np.isnan(piece[:, 0])] for piece in np.split(line, gaps)]


def points_in(model: Model, window: Ranges) -> list[tuple[str, float, float]]:
    """Return the codimension-two points in a window: name, δ, ε.

    For a thread. The name of another one would reach into it.

    Returns
    -------
    list[tuple[str, float, float]]
        Name, δ and ε of each.
    """
    (left, right), (bottom, top) = window
    return [
        (point.name, point.delta, point.epsilon)
        for point in _points(model)
        if left <= point.delta <= right and bottom <= point.epsilon <= top
    ]


@lru_cache(maxsize=64)
def _points(model: Model) -> Sequence[Any]:
    with np.errstate(all="ignore"):
        return model.codimension_two()
