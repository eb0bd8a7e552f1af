"""The library's exceptions: one base, so that a caller can catch everything of ours in one clause."""

import math


class RattleError(Exception):
    """Base of every exception that this project raises."""


class ParameterError(RattleError, ValueError):
    """A parameter or an initial condition outside the model's domain; the message says which and why."""


def require(ok: bool, message: str) -> None:
    """Raise ParameterError with this message unless ok."""
    if not ok:
        raise ParameterError(message)


def require_finite(name: str, value: float) -> float:
    """Return value as a float; raise ParameterError unless it is a finite number."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ParameterError(f"{name} must be a number, got {value!r}") from None
    require(math.isfinite(number), f"{name} must be finite, got {number}")
    return number


def require_number(name: str, value: float, *, positive: bool = False) -> float:
    """Return value as a float; raise ParameterError unless it is a finite number ≥ 0 (> 0 if positive)."""
    number = require_finite(name, value)
    if positive:
        require(number > 0.0, f"{name} must be greater than 0, got {number}")
    else:
        require(number >= 0.0, f"{name} must not be negative, got {number}")
    return number
