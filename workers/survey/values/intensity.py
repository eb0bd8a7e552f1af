"""Variables of the group `intensity`: how hard each attractor, all samples and the worst attractor rattle."""

import numpy as np

from gear_rattle.workers.survey.values.cells import Cells
from gear_rattle.workers.survey.values.evaluate import Evaluate, arrange_in_slots
from gear_rattle.workers.survey.values.schema import CELL, Group, Quantity
from rattle.intensity import natural_energy

_SLOT = ("attractor", *CELL)
_MODEL = "equation 2.4 of doi:10.1137/090759641, impact by impact"
_PER = "per forcing period"
_LEVEL = "in dB relative to 2π²δ², that of A and C"

#: Name and description of each field. A field is stored for each attractor, for all samples of a cell together, and for
#: the cell's attractor with the largest energy.
_FIELDS = (
    ("impacts_plus", f"impacts on or contacts with Σ+ {_PER}"),
    ("impacts_minus", f"impacts on or contacts with Σ- {_PER}"),
    ("mean_speed", "mean speed of the impacts"),
    ("largest_speed", "largest speed of an impact"),
    ("energy", f"sum of v²/2 over the impacts {_PER}"),
    ("level", f"energy {_PER}, {_LEVEL}"),
    ("contact", "share of the time in contact; of the impacting gear 1 if quiet, else 0"),
)
_ERRORS = tuple(each for each in _FIELDS if each[0] not in ("largest_speed", "level"))


def _intensity_of_attractors(cells: Cells, field: str) -> np.ndarray:
    """Return a field of every attractor of the cells, shape (attractors,)."""
    if field == "level":
        return _convert_energies_to_decibels(
            cells.intensities.energy, cells.delta[cells.attractors.cell % cells.delta.size]
        )
    return np.asarray(getattr(cells.intensities, field))


def _convert_energies_to_decibels(energy: np.ndarray, delta: np.ndarray) -> np.ndarray:
    """Return energies per forcing period as levels in dB, relative to 2π²δ² (`natural_energy`) at each damping δ."""
    with np.errstate(divide="ignore"):  # the level of quiet running is −inf
        return np.asarray(10.0 * np.log10(energy / natural_energy(delta)))


def _slot_intensity_evaluator(field: str) -> Evaluate:
    return lambda cells: arrange_in_slots(cells, _intensity_of_attractors(cells, field), np.nan, "float64")


def _mean_over_samples(cells: Cells, values: np.ndarray) -> np.ndarray:
    """Return the mean of `values` over the samples of each cell; a sample has the value of the attractor it reached.

    values: a number for each attractor, NaN if unknown. The mean is NaN if a sample reached an attractor with NaN.

    Returns
    -------
    np.ndarray
        Shape (cells,).
    """
    won = np.where(cells.attractors.samples > 0, cells.attractors.samples * values, 0.0)
    return np.bincount(cells.attractors.cell, won, cells.delta.size * cells.epsilon.size) / cells.sample_count


def _sample_intensity_evaluator(field: str) -> Evaluate:
    def evaluate(cells: Cells) -> np.ndarray:
        return _intensity_over_samples(cells, field).reshape(cells.shape)

    return evaluate


def _intensity_over_samples(cells: Cells, field: str) -> np.ndarray:
    found = cells.intensities
    if field == "mean_speed":
        impacts = found.impacts_plus + found.impacts_minus
        rate = _mean_over_samples(cells, impacts)
        return np.divide(
            _mean_over_samples(cells, impacts * found.mean_speed), rate, out=np.zeros_like(rate), where=rate != 0.0
        )
    if field == "largest_speed":
        largest = np.zeros(cells.delta.size * cells.epsilon.size)
        won = cells.attractors.samples > 0
        with np.errstate(invalid="ignore"):  # no warning of NaN: an unknown speed makes its cell NaN
            np.maximum.at(largest, cells.attractors.cell[won], found.largest_speed[won])
        return largest
    if field == "level":
        return _convert_energies_to_decibels(
            _mean_over_samples(cells, found.energy), np.tile(cells.delta, cells.epsilon.size)
        )
    if field == "energy_error":
        share = cells.attractors.samples / cells.sample_count
        return np.sqrt(_mean_over_samples(cells, share * found.energy_error**2))
    return _mean_over_samples(cells, _intensity_of_attractors(cells, field))


def _worst_attractor_evaluator(field: str) -> Evaluate:
    """Return the function that evaluates a field of each cell's attractor with the largest energy.

    Attractors that no sample reached count too. The value is NaN if the energy of an attractor of the cell is unknown.

    Returns
    -------
    Evaluate
        A function of the cells.
    """

    def evaluate(cells: Cells) -> np.ndarray:
        cell = cells.attractors.cell
        by_energy = np.lexsort((cells.intensities.energy, cell))  # an unknown energy (NaN) is last
        worst = by_energy[np.searchsorted(cell, np.arange(cells.delta.size * cells.epsilon.size), side="right") - 1]
        values = _intensity_of_attractors(cells, field)[worst]
        return np.where(np.isnan(cells.intensities.energy[worst]), np.nan, values).reshape(cells.shape)

    return evaluate


def _intensity_quantity(name: str, dims: tuple[str, ...], words: str, evaluate: Evaluate) -> Quantity:
    return Quantity(name, Group.INTENSITY, dims, "float64", words, _MODEL, evaluate)


QUANTITIES: tuple[Quantity, ...] = (
    *(
        _intensity_quantity(f"attractor_{name}", _SLOT, words, _slot_intensity_evaluator(name))
        for name, words in _FIELDS
    ),
    *(
        _intensity_quantity(
            f"attractor_{name}_error",
            _SLOT,
            f"half-width of the 95 % interval of attractor_{name}; 0 unless chaotic",
            _slot_intensity_evaluator(f"{name}_error"),
        )
        for name, _words in _ERRORS
    ),
    *(
        _intensity_quantity(f"sample_{name}", CELL, f"{words}, of the whole sample", _sample_intensity_evaluator(name))
        for name, words in _FIELDS
    ),
    _intensity_quantity(
        "sample_energy_error",
        CELL,
        "half-width of the 95 % interval of sample_energy at these basin fractions",
        _sample_intensity_evaluator("energy_error"),
    ),
    *(
        _intensity_quantity(
            f"worst_{name}",
            CELL,
            f"{words}, of the attractor with the largest energy",
            _worst_attractor_evaluator(name),
        )
        for name, words in _FIELDS
    ),
    _intensity_quantity(
        "worst_energy_error",
        CELL,
        "half-width of the 95 % interval of worst_energy",
        _worst_attractor_evaluator("energy_error"),
    ),
)
