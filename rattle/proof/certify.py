"""The public entry to proofs of periodic motions."""

from __future__ import annotations

from rattle.errors import ParameterError, require
from rattle.orbits.periodic import Periodic
from rattle.proof.certificate import Certificate, Exact, exact_number

SAME = 1e-14  # largest relative difference that counts as rounding


def certify(
    orbit: Periodic,
    delta: Exact | None = None,
    epsilon: Exact | None = None,
    beta: Exact | None = None,
    **added: Exact | None,
) -> Certificate:
    """Prove that a computed periodic motion exists and has its label, and enclose its multipliers.

    The motion is the only one close to the computed one. Needs the extra `proof`. Source: docs/proofs.md.

    Parameters
    ----------
    orbit : PeriodicOrbit
        The computed motion.
    delta, epsilon, beta : float, str or Fraction, optional
        Exact parameters of the proof, such as "0.6" or "3/5". They may differ from those of the motion by rounding
        only. Default: the doubles at which the motion was computed.

    Returns
    -------
    Certificate
        The theorem. `rattle certify --check` verifies it independently.

    Raises
    ------
    ParameterError
        If an exact parameter is not that of the motion.
    NotProvedError
        If the proof fails. The message names the failed step. The motion may exist nevertheless.
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
            raise ParameterError(
                f"the motion was computed at {name} = {has!r}, not computed at {given}: give equal values"
            )
    from rattle.proof.finder import certified  # imported here because it needs python-flint

    return certified(orbit, parameters)
