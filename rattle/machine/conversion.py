"""The numbers of machines as parameters of the model, and what a unit of it is there: plain numbers, or arrays of them.

docs/decisions/0025-machine.md has every step for two equal gears, docs/decisions/0065-two-gears.md for two unlike ones.
"""

from typing import Any, NamedTuple

import numpy as np

from rattle.flight.forcing import TWO_PI

DRIVES = {"torque": 1.0, "speed": 2.0}  # Φ of the model over φ + (e/r) cos Ωt, of two equal gears


class Units(NamedTuple):
    """SI units of the model's units; multiply by them.

    length (m): of Φ along the line of action. time (s): a forcing period. velocity (m/s): of speeds, along the line of
    action. energy (J): of v²/2, for the kinetic energy of an impact. power (W): of v²/2 per forcing period. force (N):
    between the teeth. frequency (Hz): of orders.
    """

    length: Any
    time: Any
    velocity: Any
    energy: Any
    power: Any
    force: Any
    frequency: Any


class Reduced(NamedTuple):
    """Two gears as the one coordinate between their teeth has them, plain numbers or arrays.

    If both gears are equal these are their own numbers, and `scale` is that of `DRIVES`.

    Parameters
    ----------
    inertia, drag : float
        kg m² and N m s/rad, referred to the first gear and the forcing's speed; their ratio is the rate of x'.
    radius : float
        m, base radius of the first gear.
    speed : float
        rad/s, 2π over the forcing period.
    scale : float
        Φ of the model over x/radius.
    ratio : float
        Base radius of the first gear over that of the second.
    rate_difference : float
        (γ₁ − γ₂)²m₁m₂/(m₁ + m₂)², 1/s², which the single rate leaves out; 0 where it is exact.
    drift : float
        m/s², what drives the teeth together without a load.
    """

    inertia: Any
    drag: Any
    radius: Any
    speed: Any
    scale: Any
    ratio: Any
    rate_difference: Any
    drift: Any


def reduced(
    inertia: Any,
    drag: Any,
    radius: Any,
    speed: Any,
    drive: str,
    driven_inertia: Any,
    driven_drag: Any,
    driven_radius: Any,
    base: float = 1.0,
) -> Reduced:
    """Reduce two gears to one equation for x = r₁θ₁ − r₂θ₂, in forcing periods of 1/base revolutions of the first.

    With m = I/r² and γ = c/I of either gear, and V the mean speed of the base circles,

        x'' = m₂γ₂V/μ + T₂/(r₂μ) − γx',      γ = (γ₁m₂ + γ₂m₁)/(m₁ + m₂),      1/μ = 1/m₁ + 1/m₂.

    An imposed speed is m₁ = ∞. With γ₁ = γ₂ this is exact; else it leaves out (γ₂ − γ₁)(u − V), u being the speed of
    the common motion (`rate_error`).

    Parameters
    ----------
    inertia, drag, radius, driven_inertia, driven_drag, driven_radius : float or ndarray
        The numbers of the first and the second gear.
    speed : float or ndarray
        Mean speed of the first gear, rad/s.
    drive : str
        Which of its "torque" and its "speed" is imposed.
    base : float
        Forcing periods in a revolution of the first gear.

    Returns
    -------
    Reduced
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
        slowed = _plain(np.where(same, 1.0, rate2 / (rate2 + (rate1 - rate2) * share)))
        difference = np.where(same, 0.0, (rate1 - rate2) ** 2 * share * (1.0 - share))
    drift = heavier * rate2 * radius * speed
    scale = 2.0 * base / (heavier * slowed)
    reduced_inertia, reduced_drag = inertia2 * slowed / base, drag2 / base
    made = (reduced_inertia, reduced_drag, radius, speed * base, scale, ratio, difference, drift)
    return Reduced(*map(_plain, made))


def _plain(number: Any) -> Any:
    """Return a float of an array without axes, an array as it is."""
    return float(number) if np.ndim(number) == 0 else number


def rate_error(pair: Reduced, backlash: Any, forcing: Any, load: Any) -> Any:
    """Return the largest share of the driving force that the single rate of `reduced` leaves out, once settled.

    The common motion has m₁u₁ + m₂u₂ = (m₁ + m₂)u, which impacts do not change, so y = u − V obeys y' = −Γy − kx' with
    k = (γ₁ − γ₂)m₁m₂/(m₁ + m₂)². Then y + kx stays below |k| max|x|, so |y| ≤ 2|k| max|x|, and |x| ≤ j/2 + max|e|.

    Parameters
    ----------
    pair : Reduced
        The two gears.
    backlash, forcing : float or ndarray
        j, and the sum of the amplitudes of the transmission error, in m.
    load : float or ndarray
        The load torque over the drag torque.

    Returns
    -------
    float or ndarray
        The bound, 0 where the reduction is exact.
    """
    with np.errstate(all="ignore"):  # what hardly turns is driven by nothing
        share = np.divide(2.0 * pair.rate_difference * (0.5 * backlash + forcing), pair.drift * (1.0 + load))
    return _plain(np.where(np.equal(pair.rate_difference, 0.0), 0.0, share))


def damping(pair: Reduced) -> Any:
    """Return δ = 2πc/(IΩ)."""
    return np.divide(TWO_PI * pair.drag, pair.inertia * pair.speed)  # infinite of what turns too slowly


def over_radius(length: Any, pair: Reduced) -> Any:
    """Return ε of an amplitude of the transmission error, along the line of action."""
    return pair.scale * length / pair.radius


def half_backlash(backlash: Any, pair: Reduced) -> Any:
    """Return β."""
    return pair.scale * backlash / (2.0 * pair.radius)


def units(pair: Reduced) -> Units:
    """Return the SI sizes of the model's units of length, time, speed, energy, power, force and frequency."""
    length, time = pair.radius / pair.scale, TWO_PI / pair.speed
    force = _plain(np.divide(0.5 * pair.inertia, pair.radius * time * time))
    energy = force * length
    power, speed, frequency = (_plain(np.divide(each, time)) for each in (energy, length, 1.0))
    return Units(length, time, speed, energy, power, force, frequency)
