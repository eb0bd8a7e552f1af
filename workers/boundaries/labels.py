"""The motions that a traced curve makes or ends."""

from rattle import KINDS, curves

QUIET, PERIODIC = (KINDS.index(kind) for kind in ("quiet", "periodic"))
Label = tuple[int, int, int, int]  # kind, m, n₊, n₋
QUIET_LABEL: Label = (QUIET, 0, 0, 0)


def labels_on_curve(name: str) -> frozenset[Label]:
    """Return the attractors that a period-one curve makes or ends.

    Curves of the stiff gear have the names of their limits.

    Returns
    -------
    frozenset[Label]
        Each with kind, m, n₊ and n₋.
    """
    if name == curves.QUIET_LIMIT:
        return frozenset({QUIET_LABEL})
    definition = curves.CURVES[name]
    return labels(definition.walls, 1, definition.impact, definition.kind == "PD")


def labels(walls: tuple[int, ...], m: int, impact: int | None, flip: bool) -> frozenset[Label]:
    """Return the labels of a motion, of the motion without its grazing impact, and of the one doubled by a flip."""
    plus, minus = walls.count(1), walls.count(-1)
    found = {(PERIODIC, m, plus, minus)}
    if impact is not None:
        found.add((PERIODIC, m, plus - (walls[impact] > 0), minus - (walls[impact] < 0)))
    if flip:
        found.add((PERIODIC, 2 * m, 2 * plus, 2 * minus))
    return frozenset(found)
