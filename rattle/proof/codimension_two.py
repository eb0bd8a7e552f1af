"""COD20 to COD23 as theorems: points of the plane where C grazes Σ⁻ and one thing more, enclosed to some 20 digits.

With X = ε cos 2πτ and Y = ε sin 2πτ = 2 − δ coth (δ/2), which closes P(1,1,0) (v = 2πδ), its flight after s is

    F(s) = 4πs − 4π (1 − e^(−δs))/(1 − E) − X (1 − cos 2πs) − Y sin 2πs,      E = e^(−δ),

so a graze, F = −2β and F' = 0, and a condition on its trace 1 + E − 4π (1 − E) X/δ² are three equations in (δ, X, s).
At COD23 it is det J(1) + det J(−1) = 0 of the motion that makes the impact (`rattle.impacting.bifurcations`), which
where it grazes says ∂(w₀ + w₁)/∂τ = 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from rattle.errors import NotProvedError
from rattle.impacting.bifurcations.codimension_two import codimension_two
from rattle.proof.balls import PI, arb, arb_mat, arb_series, ball, ends, precision
from rattle.proof.certificate import Ends, Exact, exact
from rattle.proof.flights import UP, Plane, extrema, flight
from rattle.proof.krawczyk import enclosed

Series = arb_series


def _flip(delta: Series, x: Series, _s: Series, end: Series) -> Series:
    return delta * delta * 2 * (1 + end) - 4 * PI() * (1 - end) * x


def _equal_multipliers(delta: Series, x: Series, _s: Series, _end: Series) -> Series:
    root = (-delta / 2).exp()
    return delta * delta * (1 - root) - 4 * PI() * (1 + root) * x


def _no_square_root(delta: Series, x: Series, s: Series, end: Series) -> Series:
    early, late = (-delta * s).exp(), (-delta * (1 - s)).exp()
    impacts = 1 / (1 - early) + late / (1 - late)
    return delta * delta * (2 * (1 + end) / (1 - end) - impacts) - 4 * PI() * x


def _born(_delta: Series, x: Series, _s: Series, _end: Series) -> Series:
    return x


Condition = Callable[[Series, Series, Series, Series], Series]
#: What vanishes, besides, of (δ, X, s, E).
CONDITIONS: dict[str, Condition] = {
    "COD20": _flip,
    "COD21": _equal_multipliers,
    "COD22": _born,
    "COD23": _no_square_root,
}


@dataclass(frozen=True)
class CodimensionTwoProof:
    """A theorem: in the box of these ends there is exactly one point of the kind, and its flight meets Σ⁻ in its one
    minimum and nowhere else. phase: τ of the departure from Σ⁺; time: from there to the graze.
    """

    name: str
    beta: Fraction
    delta: Ends
    epsilon: Ends
    phase: Ends
    time: Ends


@dataclass(frozen=True)
class _Equations:
    """The three equations, somewhere."""

    beta: arb
    condition: Condition
    at: Sequence[arb]

    @property
    def residual(self) -> list[arb]:
        """R (3,)."""
        return [each[0] for each in self._values([arb_series([x]) for x in self.at])]

    @cached_property
    def jacobian(self) -> arb_mat:
        """∂R/∂(δ, X, s), each column by a series of first order."""
        columns = []
        for k in range(3):
            moved = [arb_series([x, 1] if j == k else [x]) for j, x in enumerate(self.at)]
            columns.append([each[1] for each in self._values(moved)])
        return arb_mat(columns).transpose()

    def _values(self, at: Sequence[arb_series]) -> list[arb_series]:
        (delta, x, s), two_pi = at, 2 * PI()
        end, lost = (-delta).exp(), (-delta * s).exp()
        y = 2 - delta * (1 + end) / (1 - end)
        sine, cosine = (two_pi * s).sin(), (two_pi * s).cos()
        height = 2 * two_pi * (s - (1 - lost) / (1 - end)) - x * (1 - cosine) - y * sine + 2 * self.beta
        slope = 2 * (1 - delta * lost / (1 - end)) - x * sine - y * cosine
        return [height, slope, self.condition(delta, x, s, end)]


def prove_codimension_two(beta: Exact = "0.6") -> tuple[CodimensionTwoProof, ...]:
    """COD20, COD21, COD23 and COD22 at a half-backlash, those that it has, each proved.

    Raises ParameterError, and NotProvedError.
    """
    number = exact("beta", beta)
    found = []
    for point in codimension_two(float(number)):
        with precision():
            found.append(_proved(point.name, number, point.delta, point.epsilon))
    return tuple(found)


def _proved(name: str, beta: Fraction, delta: float, epsilon: float) -> CodimensionTwoProof:
    half_backlash = ball(beta)
    start = _start(name, delta, epsilon)
    zero = enclosed(lambda at: _Equations(half_backlash, CONDITIONS[name], at), start).zero
    delta_ball, x, s = zero
    end = (-delta_ball).exp()
    y = 2 - delta_ball * (1 + end) / (1 - end)
    size = (x * x + y * y).sqrt()
    turn = (x / size).acos() / (2 * PI())
    tau = turn if y > 0 else 1 - turn
    _require_touches(Plane(delta_ball, size, half_backlash), tau, s, name)
    return CodimensionTwoProof(name, beta, ends(delta_ball), ends(size), ends(tau), ends(s))


def _start(name: str, delta: float, epsilon: float) -> np.ndarray:
    """(δ, X, s) in doubles."""
    y = 2 - delta / math.tanh(delta / 2)
    x = 0.0 if name == "COD22" else math.sqrt((epsilon - y) * (epsilon + y))
    lost = -math.expm1(-delta)

    def slope(s: float) -> float:
        turn = 2 * math.pi * s
        return 2 - 2 * delta * math.exp(-delta * s) / lost - x * math.sin(turn) - y * math.cos(turn)

    times = np.linspace(0.0, 1.0, 101)
    signs = np.sign([slope(s) for s in times])
    rising = np.flatnonzero((signs[:-1] < 0) & (signs[1:] > 0))
    if rising.size != 1:
        raise NotProvedError(f"the flight of {name} has not one minimum")
    return np.array([delta, x, brentq(slope, times[rising[0]], times[rising[0] + 1], xtol=1e-15)])


def _require_touches(plane: Plane, tau: arb, s: arb, name: str) -> None:
    """Raise NotProvedError unless the flight of a period from τ has one extremum, a minimum: that of the graze."""
    turn = (2 * tau).sin_cos_pi()
    whole = flight(plane, tau, tau + 1, turn, turn, arb(0))
    if not (0 < s < 1 and whole.w0 < 0 and [kind for kind, _ in extrema(whole, f"the flight of {name}")] == [UP]):
        raise NotProvedError(f"the flight of {name} is not proved to turn once")
