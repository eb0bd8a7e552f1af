"""The transmission error of two gears as one sum of harmonics over their common period.

The common period of a pair with tooth numbers z₁ and z₂ contains lcm(z₁, z₂) meshes. In the common period, a component
of order k of the first gear's revolution has the order k z₂/gcd, a component of the second gear's revolution the order
k z₁/gcd, and a component of the tooth mesh the order k lcm. The forcing period is the shortest period that all
components share: one mesh if all components are of the mesh.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.errors import require, require_finite
from rattle.parameters import HIGHEST_ORDER, MOST_HARMONICS, Harmonic

Component = tuple[Fraction, Any, Any]  # order of the first gear's revolution, amplitude in m, phase in turns
#: Amplitudes of a machine by name, and their orders in the tooth mesh; 0 means order 1 of the second gear's revolution.
AMPLITUDES = {"driven_eccentricity": 0, "mesh_error": 1, "mesh_error_2": 2, "mesh_error_3": 3}


class PairForcing(NamedTuple):
    """The transmission error of one pair of gears, or of many as arrays (…,).

    Parameters
    ----------
    periods_per_revolution : float
        Forcing periods in a revolution of the first gear.
    amplitude : float or ndarray
        Amplitude of the first harmonic in m, or the largest amplitude if there is no first harmonic; it determines ε.
    amplitude_sum : float or ndarray
        Sum of all amplitudes in m, a bound of the error.
    orders : tuple of int
        Orders in the forcing period, rising. They begin with 1, or are empty if there is no transmission error.
    relative_amplitudes, phase : ndarray, (K, …)
        Amplitude of each order over `amplitude`, and phase in turns.
    """

    periods_per_revolution: float
    amplitude: Any
    amplitude_sum: Any
    orders: tuple[int, ...]
    relative_amplitudes: NDArray[np.float64]
    phase: NDArray[np.float64]

    def harmonics(self, number: Any = ()) -> tuple[Harmonic, ...]:
        """Return the argument `harmonics` of `rattle.Gear` for this forcing: all harmonics but the first.

        `rattle.Gear` adds a first harmonic of amplitude 1, so the result does not list it. If the forcing has no first
        harmonic, the result contains order 1 with amplitude 0. number: the index of the pair of gears, if there are
        many.

        Returns
        -------
        tuple of Harmonic
            Order, amplitude over `amplitude`, and phase of each.
        """
        found = []
        for order, size, phase in zip(self.orders, self.relative_amplitudes, self.phase, strict=True):
            each = int(order), float(size[number]), float(phase[number])
            if each[1] > 0.0 if order > 1 else each[1:] != (1.0, 0.0):
                found.append(each)
        return tuple(found)


def check_components(name: str, given: Iterable[Any]) -> tuple[tuple[int, float, float], ...]:
    """Check components of a transmission error; return a tuple of (order, amplitude in m, phase in turns)."""
    shape = f"{name} must be a list of (order, amplitude in metres, phase in turns), such as [(20, 1e-7, 0.0)]"
    try:
        rows = [tuple(each) for each in given]
    except TypeError:
        rows = [()]
    found, seen = [], set()
    for row in rows:
        require(len(row) == 3, f"{shape}, got {given!r:.80}")
        order = require_finite(f"an order of {name}", row[0])
        require(order == int(order) and order >= 1, f"an order of {name} must be an integer from 1 on, got {order:g}")
        require(order not in seen, f"{name} has order {order:g} twice: add both to one component")
        seen.add(order)
        amplitude = f"the amplitude of order {order:g} of {name}"
        size = require_finite(amplitude, row[1])
        require(size >= 0.0, f"{amplitude} must not be negative: add half a turn to its phase")
        found.append((int(order), size, require_finite(f"the phase of order {order:g} of {name}", row[2]) % 1.0))
    return tuple(found)


def components_of_transmission_error(
    teeth: int | None,
    driven_teeth: int | None,
    numbers: dict[str, Any],
    errors: Sequence[tuple[int, Any, Any]] = (),
    driven_errors: Sequence[tuple[int, Any, Any]] = (),
) -> list[Component]:
    """Return all components (sinusoidal parts) of the transmission error with an amplitude above 0.

    Parameters
    ----------
    teeth, driven_teeth : int, optional
        Tooth numbers. Unless both are given, both gears turn at the same speed. `teeth` is required if `numbers` has
        an amplitude at the tooth mesh.
    numbers : dict
        Amplitudes in m by name: eccentricity, and the names in `AMPLITUDES`.
    errors, driven_errors : sequence of (int, amplitude, phase)
        Components by their order in the revolution of the first and of the second gear.

    Returns
    -------
    list of Component
        The order (periods per revolution of the first gear), amplitude and phase of each component.

    Raises
    ------
    ParameterError
        If `numbers` has an amplitude at the tooth mesh, but `teeth` is None.
    """
    turns = Fraction(1) if teeth is None or driven_teeth is None else Fraction(teeth, driven_teeth)
    found: list[Component] = [(Fraction(1), numbers.get("eccentricity", 0.0), 0.0)]
    for name, mesh in AMPLITUDES.items():
        if not np.any(numbers.get(name, 0.0)):
            continue
        require(
            teeth is not None or mesh == 0,
            f"{name} has an order of the tooth mesh, which depends on the number of teeth: give teeth too",
        )
        found.append((turns if mesh == 0 else Fraction(mesh * (teeth or 1)), numbers[name], 0.0))
    found.extend((Fraction(order), size, phase) for order, size, phase in errors)
    found.extend((order * turns, size, phase) for order, size, phase in driven_errors)
    return [each for each in found if np.any(each[1])]


def assemble_forcing(components: Sequence[Component]) -> PairForcing:
    """Return the sum of all components over the period that they share.

    Components of one order are added as phasors. Time 0 is where the first harmonic, if there is one, has phase 0.

    Returns
    -------
    PairForcing
        Amplitudes in m, phases in turns.

    Raises
    ------
    ParameterError
        If an order, or the number of harmonics, exceeds its limit.
    """
    if not components:
        return PairForcing(1.0, 0.0, 0.0, (), np.empty((0,)), np.empty((0,)))
    whole = math.lcm(*(order.denominator for order, _, _ in components))
    base = Fraction(math.gcd(*(int(order * whole) for order, _, _ in components)), whole)
    of: dict[int, list[tuple[Any, Any]]] = {}
    for order, size, phase in components:
        of.setdefault(int(order / base), []).append((size, phase))
    orders = tuple(sorted({1, *of}))
    require(
        orders[-1] <= HIGHEST_ORDER,
        f"the parts of the transmission error share a period of {1 / float(base):g} revolutions, in which the fastest "
        f"has order {orders[-1]}, above the limit of {HIGHEST_ORDER}: leave out the part that matters least, or high "
        "orders",
    )
    require(
        len(orders) <= MOST_HARMONICS,
        f"the transmission error has {len(orders)} harmonics, too many: give the {MOST_HARMONICS - 1} largest",
    )
    sizes, phases = zip(*(_phasor_sum(of.get(order, [(0.0, 0.0)])) for order in orders), strict=True)
    shape = np.broadcast_shapes(*(np.shape(size) for size in sizes))
    size, phase = (np.stack([np.broadcast_to(x, shape) for x in each]) for each in (sizes, phases))
    first, scale = size[0], np.max(size, axis=0)
    scale = np.where(first > 0.0, first, scale)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        relative = np.where(scale > 0.0, size / scale, 0.0)
    relative[0] = np.where(scale > 0.0, relative[0], 1.0)
    number = np.array(orders, float).reshape((-1, *[1] * len(shape)))
    earlier = np.where(first > 0.0, phase[0], 0.0)
    return PairForcing(float(base), scale[()], size.sum(axis=0)[()], orders, relative, (phase - number * earlier) % 1.0)


def _phasor_sum(parts: list[tuple[Any, Any]]) -> tuple[Any, Any]:
    """Return the amplitude and phase of the sum of components of one order, each given as (amplitude, phase)."""
    if len(parts) == 1:
        return parts[0]
    phasor = sum(size * np.exp(2j * np.pi * np.asarray(phase)) for size, phase in parts)
    return np.abs(phasor), np.angle(phasor) / (2.0 * np.pi)
