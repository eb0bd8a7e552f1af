"""Draw docs/images/map.svg, the rooms of the three packages and what imports what: `make map`.

Rows are the layers of the contracts in pyproject.toml; a line is an import, drawn where no way round it exists. What
the picture was made from is in it as its description, which a test compares with the imports of today.
"""

from __future__ import annotations

import json
import re
import tomllib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import grimp
import matplotlib as mpl
from matplotlib.figure import Figure

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "images" / "map.svg"
PACKAGES = ("service", "workers", "rattle")
NAMES = {"service": "gear_rattle.service", "workers": "gear_rattle.workers", "rattle": "rattle"}  # as imported
INKS = {"service": "#2b6cb0", "workers": "#2f855a", "rattle": "#b7791f"}
WIDTH, ROW = 1.55, 0.62  # of a room, and from layer to layer

Edges = set[tuple[str, str]]


def layers_of(package: str) -> list[list[str]]:
    """The rooms of a package, from the highest layer down, as its contract has them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (found,) = (each["layers"] for each in contracts if each.get("containers") == [NAMES[package]])
    return [re.findall(r"\w+", layer) for layer in found]


def imports_of(package: str) -> Edges:
    """(importer, imported) for every two rooms of a package of which one imports the other."""
    graph = grimp.build_graph(
        NAMES[package].partition(".")[0], cache_dir=None
    )  # a cache knows files by the second of their change
    rooms = {room: f"{NAMES[package]}.{room}" for layer in layers_of(package) for room in layer}
    return {
        (above, below)
        for above, importer in rooms.items()
        for below, imported in rooms.items()
        if above != below and graph.direct_import_exists(importer=importer, imported=imported, as_packages=True)
    }


def needed(edges: Edges) -> Edges:
    """The edges that no longer way stands for."""
    below: dict[str, set[str]] = {}

    def reached(room: str) -> set[str]:
        if room not in below:
            below[room] = set()
            for start, end in edges:
                if start == room:
                    below[room] |= {end} | reached(end)
        return below[room]

    return {(a, b) for a, b in edges if not any(b in reached(c) for start, c in edges if start == a and c != b)}


def facts() -> dict[str, list[list[str]]]:
    """All imports between rooms."""
    return {package: sorted(map(list, imports_of(package))) for package in PACKAGES}


def drawn() -> dict[str, list[list[str]]]:
    """Return the imports from which the picture was drawn."""
    description = ElementTree.parse(PICTURE).find(".//{http://purl.org/dc/elements/1.1/}description")
    assert description is not None
    found: dict[str, list[list[str]]] = json.loads(description.text or "")
    return found


def draw() -> Figure:
    """The picture: the packages beside each other, a row for each layer."""
    figure = Figure((13.0, 8.2))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    left = 0.0
    for package in PACKAGES:
        layers = layers_of(package)
        wide = max(len(layer) for layer in layers)
        places = {
            room: (left + (wide - len(layer)) * WIDTH / 2 + (i + 0.5) * WIDTH, -row * ROW)
            for row, layer in enumerate(layers)
            for i, room in enumerate(layer)
        }
        for start, end in sorted(needed(imports_of(package))):
            (x0, y0), (x1, y1) = places[start], places[end]
            axes.annotate(
                "", (x1, y1 + 0.17), (x0, y0 - 0.17),
                arrowprops={"arrowstyle": "->", "color": "#8a94a0", "lw": 0.8, "shrinkA": 0, "shrinkB": 0},
            )  # fmt: skip
        for room, (x, y) in places.items():
            box = {"boxstyle": "round,pad=0.35", "fc": "white", "ec": INKS[package], "lw": 1.4}
            axes.text(x, y, room.lstrip("_"), ha="center", va="center", fontsize=9.5, bbox=box, zorder=3)
        axes.text(left + wide * WIDTH / 2, 0.75, package, ha="center", fontsize=15, color=INKS[package], weight="bold")
        left += wide * WIDTH + 0.5
    axes.set_xlim(-0.2, left)
    axes.set_ylim(-ROW * 11.2, 1.3)
    axes.set_axis_off()
    return figure


if __name__ == "__main__":
    mpl.rcParams["svg.hashsalt"] = "gear rattle"
    metadata = {"Date": None, "Creator": None, "Description": json.dumps(facts())}
    draw().savefig(PICTURE, metadata=metadata)
