"""The blocks of a plane on which something is proved, and what is left between them."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch

from rattle.plot.drawing import Drawing, new_figure
from rattle.proof.areas.block import ATTRACTING, LOUD, QUIET, REGIONS, SADDLE, Block
from rattle.proof.areas.shares import REGION, shares
from rattle.proof.certificate import Ends

LEFT = "#222222"  # what is not proved
INKS = ("#d9d9d9", "#9ecae1", "#a1d99b", "#fdae6b", "#bcbddc")
#: Panels: what is proved of what, each claim with its colour.
PANELS = (
    ("regions", dict(zip(REGIONS, INKS, strict=True))),
    ("C", {ATTRACTING["C"]: INKS[1], SADDLE["C"]: INKS[3], "I": INKS[0], "V": INKS[0]}),
    ("D", {ATTRACTING["D"]: INKS[2], SADDLE["D"]: INKS[3], "I": INKS[0], "II": INKS[0]}),
    ("quiet motion", {QUIET: INKS[1], LOUD: INKS[0]}),
)


def areas_figure(blocks: Sequence[Block], delta: Ends, epsilon: Ends) -> Drawing:
    """Draw blocks of this plane, a panel for each kind of claim; dark is what is not proved."""
    figure = new_figure(10.0, 8.0)
    told = next(
        share for share in shares(blocks, (delta[1] - delta[0]) * (epsilon[1] - epsilon[0])) if share.what == REGION
    )
    for axes, (name, inks) in zip(figure.subplots(2, 2).ravel(), PANELS, strict=True):
        _panel(axes, [block for block in blocks if block.claim in inks], inks)
        title = f"{name}: {told.proved:.1%} proved" if name == "regions" else name
        axes.set(title=title, xlabel="damping δ", ylabel="eccentricity ε", facecolor=LEFT)
        axes.set(xlim=[float(x) for x in delta], ylim=[float(x) for x in epsilon])
    return Drawing(figure)


def _panel(axes: Axes, blocks: Sequence[Block], inks: dict[str, str]) -> None:
    """Rectangles, and a key; claims that are not this panel's own are that it is not there."""
    corners = []
    for block in blocks:
        (left, right), (low, high) = (tuple(map(float, ends)) for ends in (block.delta, block.epsilon))
        corners.append([(left, low), (right, low), (right, high), (left, high)])
    colours = [inks[block.claim] for block in blocks]
    axes.add_collection(PolyCollection(corners, facecolors=colours, edgecolors=colours, linewidths=0.1))
    names = {inks[claim]: claim for claim in inks}
    if set(inks) != set(REGIONS):
        names |= {INKS[0]: "not there"} if INKS[0] in names and LOUD not in inks else {}
    axes.legend(handles=[Patch(color=ink, label=name) for ink, name in names.items()], fontsize=8, loc="upper left")
