"""The intensity of rattling per forcing period: exact for a periodic motion, with error bars for chaos."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.chaos import BATCHES, T_95
from rattle.errors import require_number
from rattle.flight.forcing import mean_contact_force
from rattle.intensity.forces import spectral_lines_of_force
from rattle.intensity.impacts import impacts_of_motion
from rattle.intensity.motions import (
    ENDLESS,
    Motion,
    checked_motion_kind,
    contact_phases_per_period,
    observation_periods,
    require_closed_orbit,
    require_full_observation,
)
from rattle.intensity.runs import sum_impacts_with_contacts
from rattle.intensity.visit import (
    COLUMNS,
    CONTACT,
    FASTEST,
    IMPULSE,
    ON_MINUS,
    ON_PLUS,
    SPEED,
    SQUARE,
    TIME,
    sum_impacts,
)
from rattle.orbits.iterates import MOST_IMPACTS

Array = NDArray[np.float64]


class IntensityErrors(NamedTuple):
    """95 % half-widths of the fields of `Intensity` with the same names; 0 for a field that is exact."""

    impacts_plus: float
    impacts_minus: float
    mean_speed: float
    energy: float
    contact: float
    impulse: float


EXACT = IntensityErrors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
UNKNOWN = IntensityErrors(*(math.nan for _ in EXACT))


@dataclass(frozen=True)
class Intensity:
    """The loudness of a motion: dimensionless numbers per forcing period (one revolution of the eccentric gear).

    For quiet motion all fields are 0 except `contact` and `impulse`; for undecided samples all fields are NaN. A run of
    impacts that ends in contact counts as one impact, as in the label of the motion, and contributes its largest speed
    to the mean. Energy and impulse are summed over the infinitely many impacts of the run.

    Attributes
    ----------
    impacts_plus, impacts_minus
        Impacts on Σ⁺ and Σ⁻ (of the stiff gear: contacts that begin).
    mean_speed, largest_speed
        Mean and largest speed of arrival. A chaotic motion may reach larger speeds than it did while it was observed.
    energy
        Σv²/2 over the speeds of arrival v, which is the energy that the impacts transfer. With restitution r the share
        1 − r² of it is lost.
    contact
        Share of the time in contact (of the impacting gear: 1 for quiet motion, otherwise 0).
    impulse
        Half of the difference between the impulses on Σ⁺ and those on Σ⁻; for the impacting gear Σv₊ − Σv₋, the speeds
        on both walls. In every bounded motion it is 2πδ, or 2πδ(1 + load) with a load, so its deviation from this value
        shows the accuracy.
    errors
        The 95 % half-widths of the other fields.
    """

    impacts_plus: float
    impacts_minus: float
    mean_speed: float
    largest_speed: float
    energy: float
    contact: float
    impulse: float
    errors: IntensityErrors = EXACT

    @property
    def impacts(self) -> float:
        """Impacts on both walls per forcing period."""
        return self.impacts_plus + self.impacts_minus

    def level(self, reference: float) -> float:
        """Return the energy in dB relative to `reference`, an energy per forcing period.

        A and C, with one impact of speed 2πδ, have the energy 2π²δ² (`natural_energy`).

        Returns
        -------
        float
            The level in dB; −inf if there are no impacts.

        Raises
        ------
        ParameterError
            If the reference is not positive.
        """
        ratio = self.energy / require_number("reference", reference, positive=True)
        return -math.inf if ratio == 0.0 else 10.0 * math.log10(ratio)


def natural_energy(delta: Any) -> Any:
    """Return the energy per forcing period of A and C, with one impact of speed 2πδ, as a reference for levels."""
    return 0.5 * (0.5 * mean_contact_force(delta)) ** 2


UNDECIDED = Intensity(math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, UNKNOWN)


def intensity(motion: Motion, point: Any, periods: float | None) -> Intensity:
    """Return the intensity of a motion (`RattlingGear.intensity`). point: the gear's parameter point for kernels."""
    kind = checked_motion_kind(motion)
    if kind == "quiet":
        mean = spectral_lines_of_force(point)[0][1].real
        return Intensity(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.5 * mean)
    if kind == "undecided":
        return UNDECIDED
    if kind == "periodic" and contact_phases_per_period(motion):
        return _intensity_from_sums(
            sum_impacts_with_contacts(impacts_of_motion(motion, point, None), motion.m)[None], EXACT
        )
    if kind == "periodic":
        sums = np.zeros((1, COLUMNS))
        status, tau, v, _ = sum_impacts(motion.tau, motion.v, motion.n_plus, math.inf, MOST_IMPACTS, point, sums)
        require_closed_orbit(motion, status, tau, v, sums[0, FASTEST])
        sums[0, TIME] = np.rint(sums[0, TIME])
        return _intensity_from_sums(sums, EXACT)
    periods = observation_periods(point.delta, periods)
    sums = np.zeros((BATCHES, COLUMNS))
    status, _tau, _v, time = sum_impacts(motion.tau, motion.v, ENDLESS, periods, MOST_IMPACTS, point, sums)
    require_full_observation(status, time, periods)
    return _intensity_from_sums(sums, IntensityErrors(*map(float, intensity_half_widths(sums))))


def _intensity_from_sums(sums: Array, errors: IntensityErrors) -> Intensity:
    plus, minus, mean, largest, energy, contact, impulse = map(float, intensity_fields_from_sums(sums))
    return Intensity(plus, minus, mean, largest, energy, contact, impulse, errors)


def intensity_fields_from_sums(sums: Array) -> tuple[Array, ...]:
    """Return the values of the fields of `Intensity`, each (…,), from sums (…, batches, COLUMNS) of `sum_impacts`."""
    total = sums.sum(axis=-2)
    per_period = total / total[..., TIME, None]
    return (
        per_period[..., ON_PLUS],
        per_period[..., ON_MINUS],
        total[..., SPEED] / (total[..., ON_PLUS] + total[..., ON_MINUS]),
        sums[..., FASTEST].max(axis=-1),
        0.5 * per_period[..., SQUARE],
        per_period[..., CONTACT],
        0.5 * per_period[..., IMPULSE],
    )


def intensity_half_widths(sums: Array) -> tuple[Array, ...]:
    """Return the fields of `IntensityErrors` in order, from sums (…, BATCHES, COLUMNS) of `sum_impacts`.

    Each field of `Intensity` is the ratio of two sums. The scatter of the batches about this ratio gives its error.

    Returns
    -------
    tuple[Array, ...]
        95 % half-widths, each (…,).
    """

    def half_width(numerator: Array, denominator: Array) -> Array:
        whole = denominator.sum(axis=-1, keepdims=True)
        spread = numerator - numerator.sum(axis=-1, keepdims=True) / whole * denominator
        return np.asarray(T_95 * np.sqrt((spread**2).sum(axis=-1) * BATCHES / (BATCHES - 1.0)) / whole[..., 0])

    time, impacts = sums[..., TIME], sums[..., ON_PLUS] + sums[..., ON_MINUS]
    return (
        half_width(sums[..., ON_PLUS], time),
        half_width(sums[..., ON_MINUS], time),
        half_width(sums[..., SPEED], impacts),
        half_width(0.5 * sums[..., SQUARE], time),
        half_width(sums[..., CONTACT], time),
        half_width(0.5 * sums[..., IMPULSE], time),
    )
