"""Proofs as the library offers them."""

from __future__ import annotations

from rattle.errors import ParameterError, require
from rattle.orbits.periodic import Periodic
from rattle.proof.certificate import Certificate, Exact, exact_number

SAME = 1e-14  # relative difference that rounding may leave


def certify(
    orbit: Periodic,
    delta: Exact | None = None,
    epsilon: Exact | None = None,
    beta: Exact | None = None,
    **added: Exact | None,
) -> Certificate:
    """Prove that a computed periodic motion exists, alone near by, with its label, and enclose its multipliers.

    Its parameters are the doubles that they are, or exact numbers given here that differ by rounding alone: text such
    as "0.6" or "3/5", or a Fraction. Needs the extra `proof`. Raises ParameterError, and NotProvedError where no proof
    was found, which says why; then the motion may still be there. Source: docs/proofs.md.

    Returns
    -------
    Certificate
        The certificate.

    Raises
    ------
    ParameterError
        If an exact number is not that of the motion.
    """
    require(
        isinstance(orbit, Periodic),
        f"orbit must be a periodic motion of the impacting or the stiff gear, got {type(orbit).__name__}: no proof is "
        "known of another",
    )
    events = len(orbit.walls)
    require(
        len(orbit.times) == len(orbit.speeds) == events > 0, "the motion must have a time and a speed for each wall"
    )
    parameters = {}
    asked = {"delta": delta, "epsilon": epsilon, "beta": beta, **dict.fromkeys(orbit.added), **added}
    for name, given in asked.items():
        has = getattr(orbit, name, None)
        if has is None:
            require(given is None, f"this gear has no {name}: leave it out")
            continue
        parameters[name] = exact_number(name, has if given is None else given)
        if abs(float(parameters[name]) - has) > SAME * abs(has):
            raise ParameterError(f"{name} of the motion is {has!r}: it was not computed at {given}")
    from rattle.proof.finder import certified  # with python-flint, which only proofs need

    return certified(orbit, parameters)
