"""Types of the registry of variables: groups that a request can name, variables, and dimensions."""

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from typing import Any

import numpy as np

from gear_rattle.workers.survey.values.evaluate import Evaluate
from rattle.models import MODELS, OTHERS, Capability

CELL = ("epsilon", "delta")
SLOT = "attractor"  # name of the dimension along which a cell's attractors lie, one in each slot
FIXED = OTHERS  # names of the parameters other than δ and ε, each of which has one value in a whole slice
#: Variables that are meaningful for periodic attractors only. For other attractors they describe an arbitrary state.
OF_PERIODIC = frozenset({"attractor_phase"})
#: {attribute of a complex number: its description}. A store has a variable for each of these parts.
PARTS = {"real": "real part", "imag": "imaginary part"}


class Group(StrEnum):
    """Groups of variables that a request can name."""

    REGION = "region"
    ORBITS = "orbits"
    ATTRACTORS = "attractors"
    LYAPUNOV = "lyapunov"
    GRAZING = "grazing"
    BASINS = "basins"
    INTENSITY = "intensity"
    FAMILIES = "families"


class RowForm(StrEnum):
    """The meaning of a row of an exported table: a cell, an attractor of a cell, or an orbit A to D of a cell."""

    CELLS = "cells"
    ATTRACTORS = "attractors"
    ORBITS = "orbits"


#: If a request has one of these groups, samples are followed in every cell.
SAMPLED = frozenset({Group.ATTRACTORS, Group.LYAPUNOV, Group.INTENSITY})
#: The groups that are computed only on request: basins cost several times as much as all others, intensities are two
#: dozen variables that few users need, and families need further steps after the tiles.
OPTIONAL = frozenset({Group.BASINS, Group.INTENSITY, Group.FAMILIES})
#: {group: the groups from which it is computed}. A request for the group includes these groups.
NEEDS = {Group.FAMILIES: frozenset({Group.ATTRACTORS, Group.LYAPUNOV})}
#: {group: the capability that a model needs for all variables of the group}.
GROUP_NEEDS = {
    Group.REGION: Capability.PERIOD_ONE,
    Group.ORBITS: Capability.PERIOD_ONE,
    Group.GRAZING: Capability.CORNERS,
    Group.INTENSITY: Capability.INTENSITY,
}
DEFAULT = tuple(group for group in Group if group not in OPTIONAL)


@dataclass(frozen=True)
class Coordinate:
    """A dimension of variables, with the values of its coordinate. δ and ε take their values from the request."""

    long_name: str
    values: tuple[int, ...] | tuple[str, ...] = ()


@dataclass(frozen=True)
class Quantity:
    """A stored variable: its schema, and the function that computes it for a rectangle of cells."""

    name: str
    group: Group | None  # None for variables that every survey has
    dims: tuple[str, ...]
    dtype: str
    long_name: str
    reference: str
    evaluate: Evaluate
    flags: tuple[str, ...] = ()  # meanings of the codes 0, 1, 2, …
    needs: Capability | None = None  # a capability that a model needs for this variable, besides GROUP_NEEDS

    @property
    def fill_value(self) -> int | float | complex | bool:
        """The stored value of a cell that is not computed, or that has nothing to describe, as in an empty slot."""
        fills = {"f": float("nan"), "c": complex("nan+nanj"), "b": False}
        return fills.get(np.dtype(self.dtype).kind, 0)

    def is_in_model(self, model: str) -> bool:
        """Return whether a model has the variable."""
        needed = {self.needs, GROUP_NEEDS.get(self.group)} if self.group else {self.needs}
        return (needed - {None}) <= MODELS[model].has

    @property
    def is_per_cell(self) -> bool:
        """True if the variable has a value for each cell. Tiles write these variables, not the others."""
        return self.dims[-2:] == CELL

    @property
    def parts(self) -> tuple["Quantity", ...]:
        """The variables to store: the variable itself, or the real and imaginary parts of a complex variable.

        Few programs can read complex numbers from a store.
        """
        if np.dtype(self.dtype).kind != "c":
            return (self,)
        return tuple(
            replace(
                self,
                name=f"{self.name}_{part}",
                dtype="float64",
                long_name=f"{self.long_name}, {words}",
                evaluate=partial(_real_or_imaginary_part, self.evaluate, part),
            )
            for part, words in PARTS.items()
        )

    @property
    def attributes(self) -> dict[str, Any]:
        """The attributes of the stored array, by the CF conventions."""
        attributes: dict[str, Any] = {"long_name": self.long_name, "units": "1", "references": self.reference}
        if self.flags:
            attributes |= {"flag_values": list(range(len(self.flags))), "flag_meanings": " ".join(self.flags)}
        return attributes


def is_phase(name: str) -> bool:
    """Return whether a variable is a phase, so that its values 0.99 and 0.01 are close."""
    return name.endswith("_phase")


def _real_or_imaginary_part(evaluate: Evaluate, part: str, cells: Any) -> np.ndarray:
    return np.asarray(getattr(np.asarray(evaluate(cells)), part))
