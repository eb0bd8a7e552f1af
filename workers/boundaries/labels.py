"""Find the labels of the motions that a bifurcation curve makes or ends."""

from rattle import KINDS, curves

QUIET, PERIODIC = (KINDS.index(kind) for kind in ("quiet", "periodic"))
Label = tuple[int, int, int, int]  # index of the kind in KINDS, m, n₊, n₋
QUIET_LABEL: Label = (QUIET, 0, 0, 0)


def labels_changed_at_curve(name: str) -> frozenset[Label]:
    """Return the labels of the attractors that a curve of the period-one motions, or the quiet limit, makes or ends.

    A curve of the stiff gear has the name of the curve that it tends to as κ → ∞.

    Returns
    -------
    frozenset[Label]
        Labels: kind, m, n₊ and n₋.
    """
    if name == curves.QUIET_LIMIT:
        return frozenset({QUIET_LABEL})
    definition = curves.CURVES[name]
    return labels_at_bifurcation(definition.walls, 1, definition.impact, definition.kind == "PD")


def labels_at_bifurcation(walls: tuple[int, ...], m: int, impact: int | None, flip: bool) -> frozenset[Label]:
    """Return the labels of a motion that bifurcates, and of the second motion that a graze or flip adds.

    walls: 1 or −1 for each impact of the motion, on Σ⁺ or Σ⁻. m: its period in forcing periods. impact: at a graze, the
    index of the impact of speed 0, which the second motion lacks; None at other bifurcations. flip: whether the
    bifurcation is a flip; then the second motion has twice the period.

    Returns
    -------
    frozenset[Label]
        One label at a saddle-node, otherwise two.
    """
    plus, minus = walls.count(1), walls.count(-1)
    found = {(PERIODIC, m, plus, minus)}
    if impact is not None:
        found.add((PERIODIC, m, plus - (walls[impact] > 0), minus - (walls[impact] < 0)))
    if flip:
        found.add((PERIODIC, 2 * m, 2 * plus, 2 * minus))
    return frozenset(found)
