"""The labels of the motions that a bifurcation curve makes or ends."""

from rattle import KINDS, curves

QUIET, PERIODIC = (KINDS.index(kind) for kind in ("quiet", "periodic"))
Label = tuple[int, int, int, int]  # kind, m, n₊, n₋
QUIET_LABEL: Label = (QUIET, 0, 0, 0)


def labels_on_curve(name: str) -> frozenset[Label]:
    """Return the labels of the attractors that a curve of the period-one motions makes or ends.

    A curve of the stiff gear has the name of the curve that it tends to as κ → ∞.

    Returns
    -------
    frozenset[Label]
        Labels: kind, m, n₊ and n₋.
    """
    if name == curves.QUIET_LIMIT:
        return frozenset({QUIET_LABEL})
    definition = curves.CURVES[name]
    return labels(definition.walls, 1, definition.impact, definition.kind == "PD")


def labels(walls: tuple[int, ...], m: int, impact: int | None, flip: bool) -> frozenset[Label]:
    """Return the labels of the motions at a bifurcation: the motion itself and those that a graze or flip makes of it.

    walls: 1 or −1 for each impact on Σ⁺ or Σ⁻. m: forcing periods. impact: index of the grazing impact, without which
    there is a second motion. flip: whether there is a motion of twice the period.

    Returns
    -------
    frozenset[Label]
        One or two labels, or three.
    """
    plus, minus = walls.count(1), walls.count(-1)
    found = {(PERIODIC, m, plus, minus)}
    if impact is not None:
        found.add((PERIODIC, m, plus - (walls[impact] > 0), minus - (walls[impact] < 0)))
    if flip:
        found.add((PERIODIC, 2 * m, 2 * plus, 2 * minus))
    return frozenset(found)
