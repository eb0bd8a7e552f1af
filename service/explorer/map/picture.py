"""Write the query of map.png, map.svg and map.pdf that draws a map as the page shows it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from urllib.parse import urlencode

from gear_rattle.service.explorer.common.address import DrawnMapSettings, View
from gear_rattle.service.explorer.map.colouring import Colouring
from gear_rattle.service.explorer.map.planes import Room
from gear_rattle.workers.pictures.look import LIMIT
from gear_rattle.workers.survey.values.schema import FIXED

FORMS = ("png", "svg", "pdf")


def settings_of_drawn_map(colours: Colouring, pixels: Room | None) -> DrawnMapSettings:
    """Return the colour range, the scale and the size of a drawn map. pixels: the size, None for the whole survey."""
    return DrawnMapSettings(None if colours.categorical else (colours.low, colours.high), colours.log, pixels)


def picture_query(request: dict[str, Any], view: View, seen: DrawnMapSettings | None = None) -> str:
    """Return the query of a picture of a survey's map. seen: settings of the drawn map, None if no map is drawn yet."""
    asked: dict[str, Any] = {"variable": view.variable, "index": view.index or None}
    asked["slice"] = view.slice if any(third_axis_names(request)) else None
    for name, window in {"delta": view.delta, "epsilon": view.epsilon}.items():
        asked |= {f"{name}_min": window[0], f"{name}_max": window[1]} if window else {}
    limits = view.limits if seen is None else seen.limits
    if isinstance(limits, tuple):
        asked |= {"low": limits[0], "high": limits[1]}
    else:
        asked["span"] = limits
    asked["log"] = "true" if (view.log if seen is None else seen.log) else None
    asked |= {"lines": ",".join(view.lines), "share": view.share if LIMIT in view.lines else None}
    asked["family"] = view.family
    if seen is not None and seen.pixels is not None:
        asked |= dict(zip(("pixels_delta", "pixels_epsilon"), seen.pixels, strict=True))
    return urlencode({name: value for name, value in asked.items() if value is not None} | {"caption": "true"})


def picture_links(survey: str, variable: str, query: str) -> str:
    """Return links to the pictures of a map, in HTML, with "&" escaped in the query."""
    here, query = f"v1/surveys/{survey}/map", query.replace("&", "&amp;")
    return " ".join(
        f'<a href="{here}.{form}?{query}" download="{variable}.{form}">{form.upper()}</a>' for form in FORMS
    )


def third_axis_names(request: dict[str, Any]) -> Iterator[str]:
    """Return the names of a request's third axes: one name, or none."""
    return (name for name in FIXED if isinstance(request.get(name), dict))
