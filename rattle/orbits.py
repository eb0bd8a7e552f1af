"""Period-one orbits A–D over whole parameter arrays, their Floquet multipliers and stability."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle import family
from rattle.errors import ParameterError, real_array, require
from rattle.limits import sine_offset

NAMES = ("A", "B", "C", "D")
N_MINUS = (0, 1, 0, 1)


class Orbit(NamedTuple):
    """A period-one orbit P(m, n_plus, n_minus) of the impact map, at one of its impacts on Σ⁺.

    tau is the phase in [0, 1), v > 0 the speed after impact (units: gap coordinate per forcing period), multipliers
    the two Floquet multipliers over m forcing periods (complex, product e^(−δm)).
    """

    name: str
    m: int
    n_plus: int
    n_minus: int
    tau: float
    v: float
    multipliers: tuple[complex, complex]
    stable: bool


class PeriodOne(NamedTuple):
    """Orbits A, B, C, D over arrays of parameters of shape S: (4, *S), multipliers (4, 2, *S); NaN where absent."""

    exists: NDArray[np.bool_]
    stable: NDArray[np.bool_]
    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    multipliers: NDArray[np.complex128]


def multipliers_of(trace: ArrayLike, determinant: ArrayLike) -> NDArray[np.complex128]:
    """Both roots of λ² − trace λ + determinant, the larger modulus first, along a new first axis; no cancellation."""
    t, d = np.broadcast_arrays(np.asarray(trace, np.float64), np.asarray(determinant, np.float64))
    root = np.sqrt((t * t / 4 - d).astype(np.complex128))
    large = t / 2 + np.where(t < 0, -root, root)
    with np.errstate(divide="ignore", invalid="ignore"):
        small = np.where(root.imag != 0, np.conj(large), d / large)
    return np.stack([large, small])


def parameters(delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike, **others: ArrayLike) -> list[NDArray[np.float64]]:
    """Broadcast and validate δ > 0, ε ≥ 0, β > 0, and others > 0; raises ParameterError."""
    named = {"delta": delta, "epsilon": epsilon, "beta": beta, **others}
    try:
        arrays = np.broadcast_arrays(*(real_array(name, value) for name, value in named.items()))
    except ParameterError:
        raise
    except ValueError as error:
        raise ParameterError(f"{', '.join(named)} must broadcast: {error}") from None
    for name, array in zip(named, arrays, strict=True):
        require(bool(np.isfinite(array).all()), f"{name} must be finite")
        least = name == "epsilon"
        inside = array >= 0 if least else array > 0
        require(bool(inside.all()), f"{name} must be {'at least' if least else 'greater than'} 0")
    return list(arrays)


def period_one(delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike = 0.6) -> PeriodOne:
    """The admissible period-one orbits A, B, C, D for every element of the broadcast parameters (dimensionless).

    Admissible: each flight of the closed form is a true first impact. A, C: P(1,1,0), born at SN1; B, D: P(1,1,1), at
    given ε the roots of ε(s) on one explicit family, B where it falls and D where it rises. At large ε and small δ or
    β there can be several of one letter; the one with the largest s is given (docs/decisions/0002-regions.md). Raises
    ParameterError. Source: Mason and Piiroinen (2009), sections 4 and 5.
    """
    d, e, b = parameters(delta, epsilon, beta)
    shape = d.shape
    d, e, b = (np.array(x, order="C").ravel() for x in (d, e, b))
    order = np.lexsort((d, b))
    exists, tau, v, trace = family.period_one_cells(order, d, e, b, sine_offset(d))
    decay = np.exp(-d)
    multipliers = np.moveaxis(multipliers_of(trace, decay), 0, 1)
    multipliers[~exists[:, None].repeat(2, axis=1)] = complex(np.nan, np.nan)
    with np.errstate(invalid="ignore"):
        stable = exists & (np.abs(trace) < 1 + decay)
    return PeriodOne(
        exists.reshape(4, *shape),
        stable.reshape(4, *shape),
        tau.reshape(4, *shape),
        v.reshape(4, *shape),
        multipliers.reshape(4, 2, *shape),
    )


def orbits_at(delta: float, epsilon: float, beta: float) -> tuple[Orbit, ...]:
    """The admissible orbits at one parameter point, in the order A, B, C, D."""
    found = period_one(delta, epsilon, beta)
    return tuple(
        Orbit(
            name,
            1,
            1,
            N_MINUS[i],
            float(found.tau[i]),
            float(found.v[i]),
            (complex(found.multipliers[i, 0]), complex(found.multipliers[i, 1])),
            bool(found.stable[i]),
        )
        for i, name in enumerate(NAMES)
        if found.exists[i]
    )
