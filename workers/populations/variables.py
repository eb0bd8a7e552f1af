"""The variables that the store of a population has for each gear."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gear_rattle.workers.populations.request import PopulationRequest
from gear_rattle.workers.survey.values.evaluate import OK, SOME_UNDECIDED, STATUS
from gear_rattle.workers.survey.values.quantities import DOI
from rattle.machine import UNITS
from rattle.models import ADDED, BETA
from rattle.populations import VERDICTS, ComputedGears, is_machine, row_means

GEAR, SAMPLE = "gear", "sample"
NAMES = {
    "delta": "damping δ",
    "epsilon": "eccentricity ε",
    **{each.name: each.long_name for each in (BETA, *ADDED.values())},
}
UNIT_OF = UNITS | {"rpm": "rpm"}  # {name of a number that describes a machine: its unit}

Evaluate = Callable[[PopulationRequest, ComputedGears], Any]


@dataclass(frozen=True)
class PopulationVariable:
    """A variable in the store of a population. evaluate: the function that computes its values for computed gears."""

    name: str
    dims: tuple[str, ...]
    dtype: str
    long_name: str
    evaluate: Evaluate
    units: str = "1"
    flags: tuple[str, ...] = ()  # meanings of the codes 0, 1, 2, …

    @property
    def fill_value(self) -> float | int:
        """The stored value for a gear that is not computed: NaN in a variable of floats, else 0."""
        return float("nan") if np.dtype(self.dtype).kind == "f" else 0

    @property
    def attributes(self) -> dict[str, Any]:
        """The attributes of the stored array, by the CF conventions."""
        found: dict[str, Any] = {"long_name": self.long_name, "units": self.units, "references": f"doi:{DOI}"}
        if self.flags:
            found |= {"flag_values": list(range(len(self.flags))), "flag_meanings": " ".join(self.flags)}
        return found

    def shape(self, request: PopulationRequest, rows: int) -> tuple[int, ...]:
        """Return the shape of the variable for `rows` gears: (rows,), or (rows, samples of a gear)."""
        return (rows, request.count) if SAMPLE in self.dims else (rows,)


def variables_of_population(request: PopulationRequest) -> tuple[PopulationVariable, ...]:
    """Return the variables of a population. `status` is last, so a tile whose status is written is complete."""
    names = request.plan.tolerances.names
    alone, but = ([f"{way}_{name}" for name in names] for way in ("sharing", "sharing_all_but"))
    one = (GEAR,)
    power = PopulationVariable("power", one, "float64", "mean power that the impacts hand over", _mean_power, "W")
    powers = (power,) if is_machine(request.plan.tolerances.given) else ()
    return (
        PopulationVariable(
            "part",
            one,
            "int16",
            "part of the population",
            lambda _, x: x.part,
            flags=("population", "the_same_again", *alone, *but),
        ),
        *(
            PopulationVariable(
                name, one, "float64", NAMES.get(name, name), _varied_number_evaluator(i), UNIT_OF.get(name, "1")
            )
            for i, name in enumerate(names)
        ),
        *(
            PopulationVariable(name, one, "float64", NAMES[name], _field_evaluator(name))
            for name in ComputedGears._fields
            if name in NAMES and name not in names
        ),
        PopulationVariable(
            "energy",
            (GEAR, SAMPLE),
            "float64",
            "sum of v²/2 over the impacts per revolution on each sample's attractor, in rising order; 0: quiet",
            lambda _, x: x.energy,
        ),
        PopulationVariable(
            "quiet_fraction",
            one,
            "float32",
            "share of the sample that ends quiet",
            lambda _, x: (x.energy == 0.0).mean(axis=1),
        ),
        PopulationVariable(
            "undecided_fraction",
            one,
            "float32",
            "share of the sample left undecided",
            lambda _, x: np.isnan(x.energy).mean(axis=1),
        ),
        *powers,
        PopulationVariable("verdict", one, "int8", "whether the gear passes", lambda _, x: x.verdict, flags=VERDICTS),
        PopulationVariable("status", one, "int8", "status of the gear", _gear_status, flags=STATUS),
    )


def read_population_gears(request: PopulationRequest, read: Callable[[str], np.ndarray]) -> ComputedGears:
    """Return the gears of a population from its store. read: function that returns the stored variable of a name."""
    names = request.plan.tolerances.names
    values = np.stack([read(name) for name in names], axis=1)
    delta, epsilon, beta = (read(name) for name in ("delta", "epsilon", "beta"))
    part, verdict = (read(name).astype(np.int64) for name in ("part", "verdict"))
    return ComputedGears(part, values, delta, epsilon, beta, read("energy"), verdict)


def _varied_number_evaluator(i: int) -> Evaluate:
    """Return the function that evaluates a variable as the i-th of the numbers that vary from gear to gear."""
    return lambda _, found: found.values[:, i]


def _field_evaluator(name: str) -> Evaluate:
    """Return the function that evaluates a variable as the field `name` of the computed `ComputedGears`."""
    return lambda _, found: getattr(found, name)


def _mean_power(request: PopulationRequest, found: ComputedGears) -> np.ndarray:
    """Return the mean power (n,) in W of each machine, over its decided samples."""
    units = request.plan.tolerances.points(found.values).units
    return np.asarray(row_means(found.energy) * (1.0 if units is None else units.power))


def _gear_status(_: PopulationRequest, found: ComputedGears) -> np.ndarray:
    return np.where(np.isnan(found.energy).any(axis=1), SOME_UNDECIDED, OK)
