"""Convert the SI numbers of a pair of gears to the model's parameters, and the model's units to SI.

All functions take plain numbers or arrays. The derivation is in docs/decisions/0025-machine.md for two equal gears, and
in docs/decisions/0065-two-gears.md for two different gears.
"""

from typing import Any, NamedTuple

import numpy as np

from rattle.flight.forcing import TWO_PI

#: For two equal gears with base radius r and eccentricity e, the model's Φ is θ₁ − θ₂ + (e/r) cos Ωt times this number,
#: which depends on the drive.
DRIVES = {"torque": 1.0, "speed": 2.0}


class Units(NamedTuple):
    """The SI sizes of the model's units: a number of the model times its unit is the number in SI.

    Attributes
    ----------
    length
        Unit of Φ along the line of action, m.
    time
        The forcing period, s.
    velocity
        Unit of speeds along the line of action, m/s.
    energy
        Unit of v²/2, the kinetic energy of an impact, J.
    power
        Unit of v²/2 per forcing period, W.
    force
        Unit of the force between the teeth, N.
    frequency
        One oscillation in a forcing period, Hz.
    """

    length: Any
    time: Any
    velocity: Any
    energy: Any
    power: Any
    force: Any
    frequency: Any


class ReducedPair(NamedTuple):
    """Two gears, reduced to one coordinate: x along the line of action between their teeth.

    If both gears are equal and a forcing period is one revolution, inertia, drag and radius are those of each gear, and
    `phi_per_angle` is the value in `DRIVES`.

    Parameters
    ----------
    inertia, drag : float
        The pair's inertia in kg m² and drag in N m s/rad after the reduction, referred to the first gear and the speed
        of the forcing; drag over inertia is the damping rate of x.
    radius : float
        Base radius of the first gear, m.
    speed : float
        2π over the forcing period, rad/s.
    phi_per_angle : float
        Ratio of the model's Φ to x/radius.
    radius_ratio : float
        Base radius of the first gear over that of the second.
    rate_difference : float
        (γ₁ − γ₂)²m₁m₂/(m₁ + m₂)² in 1/s², with γ and m as in `reduce_pair`: a measure of the force that the reduction
        neglects; 0 if the reduction is exact.
    drift : float
        Acceleration of x towards the driving flank by the drag alone, without a load, m/s².
    """

    inertia: Any
    drag: Any
    radius: Any
    speed: Any
    phi_per_angle: Any
    radius_ratio: Any
    rate_difference: Any
    drift: Any


def reduce_pair(
    inertia: Any,
    drag: Any,
    radius: Any,
    speed: Any,
    drive: str,
    driven_inertia: Any,
    driven_drag: Any,
    driven_radius: Any,
    base: float = 1.0,
) -> ReducedPair:
    """Reduce two gears to one equation for x = r₁θ₁ − r₂θ₂. A forcing period is 1/base revolutions of the first gear.

    With m = I/r² and γ = c/I of either gear (inertia I, base radius r, drag c), the mean speed V of the base circles
    and the load torque T₂,

        x'' = m₂γ₂V/μ + T₂/(r₂μ) − γx',      γ = (γ₁m₂ + γ₂m₁)/(m₁ + m₂),      1/μ = 1/m₁ + 1/m₂.

    An imposed speed means m₁ = ∞. The equation is exact if γ₁ = γ₂. If γ₁ ≠ γ₂, the equation neglects (γ₂ − γ₁)(u − V),
    where u is the speed of the common motion (`neglected_force_bound`).

    Parameters
    ----------
    inertia, drag, radius, driven_inertia, driven_drag, driven_radius : float or ndarray
        Inertia (kg m²), drag (N m s/rad) and base radius (m) of the first and of the second gear.
    speed : float or ndarray
        Mean speed of the first gear, rad/s.
    drive : str
        "torque" or "speed": the quantity that is imposed on the first gear.
    base : float
        Forcing periods in a revolution of the first gear.

    Returns
    -------
    ReducedPair
        The numbers from which δ, ε, β and SI units follow.
    """
    ratio = np.divide(radius, driven_radius)
    inertia2, drag2 = driven_inertia * ratio * ratio, driven_drag * ratio * ratio
    rate1, rate2 = np.divide(drag, inertia), np.divide(driven_drag, driven_inertia)
    if drive == "speed":
        heavier, slowed, difference = 1.0, 1.0, 0.0 * rate2
    else:
        share, same = inertia2 / (inertia + inertia2), rate1 == rate2
        heavier = 1.0 + np.divide(inertia2, inertia)
        slowed = _float_or_array(np.where(same, 1.0, rate2 / (rate2 + (rate1 - rate2) * share)))
        difference = np.where(same, 0.0, (rate1 - rate2) ** 2 * share * (1.0 - share))
    drift = heavier * rate2 * radius * speed
    scale = 2.0 * base / (heavier * slowed)
    reduced_inertia, reduced_drag = inertia2 * slowed / base, drag2 / base
    made = (reduced_inertia, reduced_drag, radius, speed * base, scale, ratio, difference, drift)
    return ReducedPair(*map(_float_or_array, made))


def _float_or_array(number: Any) -> Any:
    """Return a number, or an array of shape (), as a float, and any other array unchanged."""
    return float(number) if np.ndim(number) == 0 else number


def neglected_force_bound(pair: ReducedPair, backlash: Any, forcing: Any, load: Any) -> Any:
    """Return a bound of the force that the reduction of `reduce_pair` neglects, as a share of the driving force.

    The bound holds after transients; m, γ and V are those of `reduce_pair`, and u₁, u₂ the speeds of the base circles.
    The common motion has the speed u with m₁u₁ + m₂u₂ = (m₁ + m₂)u. Impacts do not change u. So y = u − V obeys
    y' = −Γy − kx' with a rate Γ > 0 and k = (γ₁ − γ₂)m₁m₂/(m₁ + m₂)². Then |y + kx| stays below |k| max|x|,
    so |y| ≤ 2|k| max|x|, and |x| ≤ j/2 + max|e|.

    Parameters
    ----------
    pair : ReducedPair
        The two gears.
    backlash, forcing : float or ndarray
        The backlash j, and the sum of the amplitudes of the transmission error e, in m.
    load : float or ndarray
        The load torque over the drag torque.

    Returns
    -------
    float or ndarray
        The bound, 0 where the reduction is exact.
    """
    with np.errstate(all="ignore"):  # at speed 0 the driving force is 0, and the quotient inf or NaN
        share = np.divide(2.0 * pair.rate_difference * (0.5 * backlash + forcing), pair.drift * (1.0 + load))
    return _float_or_array(np.where(np.equal(pair.rate_difference, 0.0), 0.0, share))


def delta_of_pair(pair: ReducedPair) -> Any:
    """Return the damping δ = 2πc/(IΩ), from the reduced drag c and inertia I and the speed Ω of the forcing."""
    # np.divide, because Python's division raises ZeroDivisionError at speed 0, where δ is infinite
    return np.divide(TWO_PI * pair.drag, pair.inertia * pair.speed)


def epsilon_of_amplitude(length: Any, pair: ReducedPair) -> Any:
    """Return ε from the amplitude of the transmission error along the line of action, `length` in m."""
    return pair.phi_per_angle * length / pair.radius


def beta_of_backlash(backlash: Any, pair: ReducedPair) -> Any:
    """Return β from the backlash along the line of action, in m."""
    return pair.phi_per_angle * backlash / (2.0 * pair.radius)


def si_units_of_model(pair: ReducedPair) -> Units:
    """Return the SI sizes of the model's units of length, time, speed, energy, power, force and frequency."""
    length, time = pair.radius / pair.phi_per_angle, TWO_PI / pair.speed
    force = _float_or_array(np.divide(0.5 * pair.inertia, pair.radius * time * time))
    energy = force * length
    power, speed, frequency = (_float_or_array(np.divide(each, time)) for each in (energy, length, 1.0))
    return Units(length, time, speed, energy, power, force, frequency)
