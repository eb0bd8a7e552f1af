"""Draw the blocks of a (δ, ε) plane on which claims are proved, and the parts on which nothing is proved."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch

from rattle.plot.colours import NAMED, REGION_COLOURS
from rattle.plot.drawing import Drawing, new_figure
from rattle.proof.areas.block import ABSENT, ATTRACTING, CAPTURED, LOUD, QUIET, REGIONS, SADDLE, ProvedBlock
from rattle.proof.areas.shares import REGION, shares_of_claims
from rattle.proof.certificate import Ends

#: Colour of the parts of the plane on which nothing is proved.
UNPROVED = "#222222"
UNSTABLE, POSSIBLE, NOTHING = "#c9bfe0", "#a1d99b", REGION_COLOURS[1]
#: The panels: for each a title, and the claims that the panel shows, with their colours.
PANELS = (
    ("regions", dict(zip(REGIONS, REGION_COLOURS[1:], strict=False))),
    ("C", {ATTRACTING["C"]: NAMED[1, 1, 0], SADDLE["C"]: UNSTABLE, ABSENT["C"]: NOTHING}),
    ("D", {ATTRACTING["D"]: NAMED[1, 1, 1], SADDLE["D"]: UNSTABLE, ABSENT["D"]: NOTHING}),
    ("quiet motion, and the speed below which it captures", {QUIET: POSSIBLE, LOUD: NOTHING}),
)


def areas_figure(blocks: Sequence[ProvedBlock], delta: Ends, epsilon: Ends) -> Drawing:
    """Draw the proved blocks of a plane, in one panel for each kind of claim; parts that are not proved are dark."""
    figure = new_figure(10.0, 8.0)
    proved_regions = next(
        share
        for share in shares_of_claims(blocks, (delta[1] - delta[0]) * (epsilon[1] - epsilon[0]))
        if share.statement == REGION
    )
    for axes, (name, inks) in zip(figure.subplots(2, 2).ravel(), PANELS, strict=True):
        _draw_claims(axes, [block for block in blocks if block.claim in inks], inks)
        if QUIET in inks:
            _draw_capture_speeds(axes, [block for block in blocks if block.claim == CAPTURED])
        title = f"{name}: {proved_regions.proved:.1%} proved" if name == "regions" else name
        axes.set(title=title, xlabel="damping δ", ylabel="eccentricity ε", facecolor=UNPROVED)
        axes.set(xlim=[float(x) for x in delta], ylim=[float(x) for x in epsilon])
    return Drawing(figure)


def _block_corners(blocks: Sequence[ProvedBlock]) -> list[list[tuple[float, float]]]:
    """Return the four corners (δ, ε) of each block."""
    ends = [(*map(float, block.delta), *map(float, block.epsilon)) for block in blocks]
    return [[(left, low), (right, low), (right, high), (left, high)] for left, right, low, high in ends]


def _draw_claims(axes: Axes, blocks: Sequence[ProvedBlock], inks: dict[str, str]) -> None:
    """Draw blocks as rectangles in the colours of their claims, with a legend."""
    colours = [inks[block.claim] for block in blocks]
    axes.add_collection(PolyCollection(_block_corners(blocks), facecolors=colours, edgecolors=colours, linewidths=0.1))
    keys = [Patch(color=ink, label=claim) for claim, ink in [*inks.items(), ("not proved", UNPROVED)]]
    axes.legend(handles=keys, fontsize=8, loc="lower right", framealpha=0.9)


def _draw_capture_speeds(axes: Axes, blocks: Sequence[ProvedBlock]) -> None:
    """Draw blocks as rectangles coloured by the proved impact speed below which every motion becomes quiet."""
    if not blocks:
        return
    speeds = [float(block.speed or 0) for block in blocks]
    drawn = PolyCollection(
        _block_corners(blocks), array=speeds, cmap="viridis", norm="log", edgecolors="face", linewidths=0.1
    )
    axes.add_collection(drawn)
    axes.figure.colorbar(drawn, ax=axes, label="impact speed v")
