"""What the URL of a parameter point's view keeps: which motion is shown, which diagram, and tolerances."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from service.explorer.design.tolerance import Tolerance
from service.explorer.point.parts import SPANS

MOST_ATTRACTORS = 1000


@dataclass(frozen=True)
class PointState:
    """The attractor (its place by falling share) or the initial condition (τ, v) shown; the diagram's direction;
    tolerances, if any were given.
    """

    attractor: int | None = None
    start: tuple[float, float] | None = None
    direction: str = "epsilon"
    tolerance: Tolerance | None = None

    @classmethod
    def read(cls, text: Mapping[str, object], v_max: float) -> PointState:
        """The state that these texts describe; what cannot be read, or is beyond v_max, is as by default."""
        direction = str(text.get("direction", ""))
        return cls(
            _attractor(text.get("attractor")),
            _start(text.get("tau"), text.get("v"), v_max),
            direction if direction in SPANS else "epsilon",
            tolerance_of(text.get("tolerance")),
        )

    def text(self) -> dict[str, str]:
        """The texts that describe it, none for what is as by default."""
        said = {"attractor": str(self.attractor)} if self.attractor is not None and self.start is None else {}
        if self.start is not None:
            said |= {"tau": repr(self.start[0]), "v": repr(self.start[1])}  # read back, they are the same numbers
        if self.tolerance is not None:
            said["tolerance"] = ",".join(map(repr, self.tolerance))
        return said | ({"direction": self.direction} if self.direction != "epsilon" else {})


def _attractor(given: object) -> int | None:
    try:
        number = int(str(given))
    except ValueError:
        return None
    return number if 0 <= number < MOST_ATTRACTORS else None


def _start(tau: object, v: object, v_max: float) -> tuple[float, float] | None:
    try:
        start = float(str(tau)), float(str(v))
    except ValueError:
        return None
    if math.isfinite(start[0]) and 0 <= start[0] < 1 and 0 < start[1] <= v_max:
        return start
    return None


def tolerance_of(given: object) -> Tolerance | None:
    """The tolerance that a text describes, None if it cannot be read."""
    try:
        found = Tolerance(*map(float, str(given).split(",")))
    except (TypeError, ValueError):
        return None
    return found if all(math.isfinite(each) and each >= 0.0 for each in found) else None
