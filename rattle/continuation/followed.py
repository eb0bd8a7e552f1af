"""What a branch of either gear says of itself, and what it gives to pandas and xarray."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rattle.flight.law import folded
from rattle.notebook import (
    Columns,
    Dataset,
    Figure,
    Tabular,
    dataset_of,
    figure_of,
    motion,
)
from rattle.numerics.complex_step import Array


class HasPoints(Protocol):
    """A branch of k motions, n impacts or contacts each."""

    multipliers: NDArray[np.complex128]
    events: tuple[Any, ...]
    ends: tuple[str, str]

    def __len__(self) -> int: ...
    @property
    def label(self) -> tuple[int, int, int]: ...
    @property
    def itinerary(self) -> Any: ...
    @property
    def delta(self) -> Array: ...
    @property
    def epsilon(self) -> Array: ...
    @property
    def kappa(self) -> Array: ...
    @property
    def departures(self) -> Array: ...
    @property
    def speeds(self) -> Array: ...
    @property
    def stable(self) -> NDArray[np.bool_]: ...
    @property
    def admissible(self) -> NDArray[np.bool_]: ...
    def _caption(self) -> str: ...
    def _columns(self) -> Columns: ...


class Followed(Tabular):
    """The part of a branch that shows it."""

    def _caption(self: HasPoints) -> str:
        events = ", ".join(f"{each.kind}{'' if each.admissible else ' (virtual)'}" for each in self.events) or "none"
        return f"branch of {motion(*self.label)}, {len(self)} points; events: {events}; ends: {', '.join(self.ends)}"

    def _columns(self: HasPoints) -> Columns:
        return {
            "delta": self.delta,
            "epsilon": self.epsilon,
            "kappa": self.kappa,
            "tau": [float(folded(time)) for time in self.departures[:, 0]],
            "v": self.speeds[:, 0],
            "multiplier_1": self.multipliers[0],
            "multiplier_2": self.multipliers[1],
            "stable": self.stable,
            "admissible": self.admissible,
        }

    def plot(self: HasPoints) -> Figure:
        """Draw speed and phase of its impacts on Σ⁺ against the parameter: stable parts solid, events marked.

        Returns a matplotlib figure. Raises MissingExtraError without matplotlib.
        """
        return figure_of(self, "branch_figure")

    def to_xarray(self: HasPoints) -> Dataset:
        """Dimensions point, multiplier and impact: parameters, multipliers, and the times and speeds with which the
        motions leave the walls. Raises MissingExtraError without xarray.
        """
        each = {name: ("point", values) for name, values in self._columns().items() if "multiplier" not in name}
        return dataset_of(
            {
                **{name: each[name] for name in ("tau", "v", "stable", "admissible")},
                "multiplier": (("number", "point"), self.multipliers),
                "departure": (
                    ("point", "impact"),
                    self.departures,
                    {"long_name": "time in forcing periods"},
                ),
                "speed": (("point", "impact"), self.speeds),
            },
            {
                **{name: each[name] for name in ("delta", "epsilon", "kappa")},
                "number": [1, 2],
                "wall": ("impact", np.array(self.itinerary.walls)),
                "beta": self.itinerary.beta,
            },
            {"motion": motion(*self.label), "ends": list(self.ends)},
        )
