"""`rattle.certify`: the proof of a computed periodic motion."""

from __future__ import annotations

from rattle.errors import ParameterError, require
from rattle.orbits.periodic_motions import PeriodicMotion
from rattle.proof.certificate import Certificate, Exact, exact_number

#: Largest relative difference between an exact parameter and the double with which the motion was computed.
SAME_PARAMETER = 1e-14


def certify(
    orbit: PeriodicMotion,
    delta: Exact | None = None,
    epsilon: Exact | None = None,
    beta: Exact | None = None,
    **added: Exact | None,
) -> Certificate:
    """Prove that a computed periodic motion exists, and enclose its multipliers.

    The theorem says that exactly one motion is near the computed motion, and that it has the same label. The extra
    `proof` is needed. The method is in docs/proofs.md.

    Parameters
    ----------
    orbit : PeriodicMotion
        A periodic motion of the impacting or the stiff gear.
    delta, epsilon, beta : Exact | None
        Exact parameters: text such as "0.6" or "3/5", or a Fraction. They may differ from those of the motion only by
        rounding. If None, the double of the motion is taken as exact.
    **added : Exact | None
        Parameters that the model adds: `kappa` of the stiff gear.

    Returns
    -------
    Certificate
        The theorem, which the independent checker verifies.

    Raises
    ------
    ParameterError
        If an exact number differs from the parameter of the motion, or the motion is of another gear.
    NotProvedError
        If no proof was found; the message says at which step. The motion may exist all the same.
    """
    require(
        isinstance(orbit, PeriodicMotion),
        f"orbit must be a periodic motion of the impacting or the stiff gear, got {type(orbit).__name__}: other "
        "motions cannot be proved",
    )
    events = len(orbit.walls)
    require(
        len(orbit.times) == len(orbit.speeds) == events > 0, "the motion must have a time and a speed for each wall"
    )
    parameters = {}
    given_numbers = {"delta": delta, "epsilon": epsilon, "beta": beta, **dict.fromkeys(orbit.added), **added}
    for name, given in given_numbers.items():
        has = getattr(orbit, name, None)
        if has is None:
            require(given is None, f"this gear has no {name}: leave it out")
            continue
        parameters[name] = exact_number(name, has if given is None else given)
        if abs(float(parameters[name]) - has) > SAME_PARAMETER * abs(has):
            raise ParameterError(f"{name} must equal that of the motion, {has!r}, up to rounding, got {given}")
    from rattle.proof.finder import prove_motion  # imports python-flint, which only proofs need

    return prove_motion(orbit, parameters)
