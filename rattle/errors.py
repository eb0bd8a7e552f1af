"""The library's exceptions, with one base class, so that one clause can catch all of them."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

# A given text longer than this is not compared with the known names: all names are shorter, and the time of a
# comparison grows as the square of the length.
LONGEST_NAME = 80
# a known name that contains the given text, not at its beginning, is suggested only if the text is at least this long
LEAST_PART_LENGTH = 3
MOST_SUGGESTED = 3  # a message suggests at most this many names
MAY_BE_ZERO = ("epsilon", "load")  # parameters that may be 0; all others must be greater than 0
AT_MOST = {"restitution": (1.0, "1 is an elastic impact")}


class RattleError(Exception):
    """Base class of the errors that this project defines.

    Attributes
    ----------
    code : str
        Stable name of the kind of error, for programs. The message is for people and may change.
    """

    code: ClassVar[str] = "not_computable"


class ParameterError(RattleError, ValueError):
    """A parameter or an initial condition is outside the model's domain; the message says which and why."""

    code = "invalid_parameter"


class NotProvedError(RattleError):
    """A claim could not be proved, although it may be true; the message names the step that failed."""

    code = "not_proved"


class MissingExtraError(RattleError, ImportError):
    """An optional dependency is not installed; the message names the extra that installs it."""

    code = "missing_extra"


def require(ok: bool, message: str) -> None:
    """Raise ParameterError with this message unless `ok` is true."""
    if not ok:
        raise ParameterError(message)


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return ": did you mean …?" for a misspelt name, or an empty string if no known name is similar.

    Parameters
    ----------
    name : object
        The given name; if it is not a string, the result is empty.
    known : iterable of str
        The valid names.

    Returns
    -------
    str
        The end of an error message, with at most three names: first the names that contain the given one, then the most
        similar names.
    """
    if not (isinstance(name, str) and 0 < len(name) <= LONGEST_NAME):
        return ""
    names = {each.lower(): each for each in known}
    typed = name.lower()
    close = [each for each in names if each.startswith(typed) or (len(typed) >= LEAST_PART_LENGTH and typed in each)]
    close = sorted(close, key=len) + difflib.get_close_matches(typed, names)
    meant = [names[each] for each in dict.fromkeys(close)][:MOST_SUGGESTED]
    return f": did you mean {' or '.join(meant)}?" if meant else ""


def require_one_of(what: str, name: object, known: Iterable[str]) -> None:
    """Raise ParameterError unless `name` is one of the known names; the message lists them and suggests the closest."""
    names = list(known)
    if not (isinstance(name, str) and name in names):
        raise ParameterError(
            f"{what} must be one of {', '.join(names)}, got {_short_repr(name)}{did_you_mean(name, names)}"
        )


def require_real_array(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return value as a float64 array; raise ParameterError unless it holds real numbers (not text, bool or masked)."""
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        raise ParameterError(f"{name} has masked elements: leave them out, or fill them")
    try:
        array: NDArray[Any] = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise ParameterError(f"{name} must be a number or an array of numbers: {error}") from None
    if array.dtype.kind not in "iuf":  # test the type first, because printing a large array for the message is slow
        raise ParameterError(f"{name} must be real numbers in double precision, got {_short_repr(value)}")
    return array.astype(np.float64)


def _short_repr(value: object) -> str:
    """Return the value as text of at most 80 characters, or a description if it is an integer too large to print."""
    try:
        return repr(value)[:80]
    except ValueError:
        return "an integer that is too large to print"


def require_integer(name: str, value: int, low: int, high: int) -> int:
    """Return value as an int; raise ParameterError unless it is an integer (no bool) from low to high."""
    integral = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not (integral and low <= value <= high):
        raise ParameterError(f"{name} must be an integer from {low} to {high}, got {_short_repr(value)}")
    return int(value)


def require_finite(name: str, value: float) -> float:
    """Return value as a float; raise ParameterError unless it is one finite real number (no text, no bool)."""
    array = require_real_array(name, value)
    require(array.ndim == 0, f"{name} must be one number, got an array of shape {array.shape}")
    number = float(array)
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


def require_pair(name: str, value: ArrayLike) -> tuple[float, float]:
    """Return value as two floats; raise ParameterError unless it is a pair of finite real numbers."""
    array = require_real_array(name, value)
    require(array.shape == (2,) and bool(np.isfinite(array).all()), f"{name} must be a pair of numbers, got {value!r}")
    return float(array[0]), float(array[1])


def broadcast_parameters(
    delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike, **others: ArrayLike
) -> list[NDArray[np.float64]]:
    """Broadcast parameters to one shape, and check that they are finite and inside their domains.

    A parameter must be > 0, or ≥ 0 if `MAY_BE_ZERO` has its name. `AT_MOST` has the largest allowed values of some
    parameters.

    Returns
    -------
    list of ndarray
        One array for each parameter, in the order given, of one shape.

    Raises
    ------
    ParameterError
        If a value is outside its domain, or the shapes do not broadcast.
    """
    named = {"delta": delta, "epsilon": epsilon, "beta": beta, **others}
    try:
        arrays = np.broadcast_arrays(*(require_real_array(name, value) for name, value in named.items()))
    except ParameterError:
        raise
    except ValueError as error:
        raise ParameterError(f"{', '.join(named)} must have shapes that broadcast: {error}") from None
    for name, array in zip(named, arrays, strict=True):
        require(bool(np.isfinite(array).all()), f"{name} must be finite")
        least = name in MAY_BE_ZERO
        inside = array >= 0 if least else array > 0
        require(bool(inside.all()), f"{name} must be {'at least' if least else 'greater than'} 0")
        if name in AT_MOST:
            most, why = AT_MOST[name]
            largest = float(array.max(initial=0.0))
            require(largest <= most, f"{name} must be at most {most:g}, got {largest:g}: {why}")
    return list(arrays)
