"""Check the arguments of an inelastic gear: restitution, load and harmonics."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from numpy.typing import ArrayLike

from rattle.errors import ParameterError, require, require_finite
from rattle.parameters import HIGHEST_ORDER, MOST_HARMONICS, Harmonic, Parameters

Harmonics = Sequence[Sequence[float]]


def check_harmonics(harmonics: Iterable[Any]) -> tuple[Harmonic, ...]:
    """Check harmonics, and return them sorted by order.

    Parameters
    ----------
    harmonics : iterable of (int, float, float)
        Order ≥ 2, amplitude relative to the first harmonic, and phase in turns. (1, 0, 0) removes the first harmonic;
        ε then only scales the amplitudes of the other harmonics.

    Returns
    -------
    tuple of Harmonic
        The harmonics, with phases in [0, 1).

    Raises
    ------
    ParameterError
        If the argument is not a list of valid harmonics; the message says what is allowed.
    """
    shape = "harmonics must be a list of (order, amplitude, phase), such as [(20, 0.0033, 0.0)]"
    try:
        given = [tuple(each) for each in harmonics]
    except TypeError:
        raise ParameterError(f"{shape}, got {harmonics!r:.80}") from None
    require(len(given) <= MOST_HARMONICS, f"{len(given)} harmonics are too many: give the {MOST_HARMONICS} largest")
    found: dict[int, Harmonic] = {}
    for each in given:
        require(len(each) == 3, f"{shape}, got {each!r:.80} in it")
        order = require_finite("the order of a harmonic", each[0])
        require(
            order == int(order),
            f"the order of a harmonic must be an integer, got {order:g}: if the forcing repeats only after several "
            "revolutions, take the common period of both gears as the unit of time",
        )
        require(order != 0, "a harmonic of order 0 is a constant and has no effect: leave it out")
        require(
            order != 1 or each[1] == 0,
            "the harmonic of order 1 is the eccentricity itself: give its amplitude as epsilon, or 0 if there is none",
        )
        require(
            order > 0,
            f"the order of a harmonic must be at least 2, got {order:g}: change the signs of order and phase",
        )
        require(order <= HIGHEST_ORDER, f"the order of a harmonic must be at most {HIGHEST_ORDER}, got {order:g}")
        require(int(order) not in found, f"order {order:g} is given twice: combine both into one harmonic")
        amplitude = require_finite(f"the amplitude of order {order:g}", each[1])
        require(amplitude >= 0, f"the amplitude of order {order:g} must not be negative: add half a turn to its phase")
        found[int(order)] = int(order), amplitude, require_finite(f"the phase of order {order:g}", each[2]) % 1.0
    require(
        1 not in found or any(size > 0 for _, size, _ in found.values()),
        "no harmonic has an amplitude above 0: give one that has, or leave out the harmonic of order 1 to keep that of "
        "epsilon",
    )
    return tuple(found[order] for order in sorted(found))


def check_inelastic_parameters(
    delta: ArrayLike,
    epsilon: ArrayLike,
    beta: ArrayLike,
    restitution: ArrayLike,
    load: ArrayLike,
    harmonics: tuple[Harmonic, ...],
) -> Parameters:
    """Return checked parameters of inelastic gears, broadcast to one shape. Raises ParameterError if one is invalid."""
    return Parameters.from_values("inelastic", delta, epsilon, beta, restitution=restitution, load=load).with_harmonics(
        harmonics
    )
