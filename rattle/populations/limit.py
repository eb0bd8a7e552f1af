"""The limit of a number of a gear up to which it runs quietly often enough, solved for."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from rattle.attractors.classify import BUDGET
from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import LARGEST_BUDGET, NATURAL, sampled_speeds
from rattle.errors import require, require_integer, require_number, require_one_of, require_pair
from rattle.flight.forcing import least_damping
from rattle.impacting.orbits.limits import quiet_limit
from rattle.machine.forcing import AMPLITUDES
from rattle.machine.given import IMPOSSIBLE, RPM, WIDEST
from rattle.models import MODELS, Capability, Inelastic, gear_at
from rattle.numerics.sampling import initial_conditions, wilson_interval
from rattle.parameters import Parameters
from rattle.populations.gears import follow_gears
from rattle.populations.plan import LARGEST_SEED, MOST_SHARE
from rattle.populations.tolerances import (
    ERROR,
    HARMONIC,
    is_machine,
    machine_of,
    model_of_numbers,
    points_of,
    require_known,
)

#: What may be asked for, and whether small ones are the safe ones.
SAFE_IF_SMALL = {
    **dict.fromkeys(("epsilon", "eccentricity", "beta", "backlash", "rpm"), True),
    **dict.fromkeys(("restitution", *AMPLITUDES), True),
    **dict.fromkeys(("delta", "drag", "load", "load_torque"), False),
}
#: What limits one cosine by closed forms.
OF_ONE_COSINE = ("epsilon", "eccentricity", "beta", "backlash", "rpm", "delta", "drag")
#: What begins at 0: scanned in even steps.
FROM_ZERO = ("epsilon", "eccentricity", "restitution", *AMPLITUDES)
SCANNED, FEW = 32, 256  # values that are looked at first, and samples of each
MOST_COUNT = 65_536
SPAN = 100.0  # of values other than eccentricities
CLOSE = 2.0**-8  # of a step of the scan: a limit is solved for to this


class Limit(NamedTuple):
    """The value until which gears run quietly often enough, in its own unit, with its 95 % interval.

    An end of the interval that is not between the values that were looked at is NaN, and so is a value: where the
    safest one is too much already, or the last not yet.
    """

    value: float
    low: float
    high: float


def design_limit(
    given: Mapping[str, Any],
    of: str,
    share: float = 0.99,
    *,
    between: tuple[float, float] | None = None,
    count: int = 2048,
    seed: int = 0,
    budget: int = BUDGET,
) -> Limit:
    """Return the limit of a number up to which a gear runs quietly with probability `share`, there and at safer ones.

    It is the largest epsilon, beta or restitution (eccentricity, mesh_error and other amplitudes, backlash, rpm of a
    machine), or the least delta or load (drag, load_torque). harmonic_20 is the amplitude of that order over the first,
    error_20 that of a machine in m.

    The probability is that of states of [0, 1) × (0, natural speed), the same `count` for every value. First SCANNED
    values are looked at from the safe side on, by default to where nothing is quiet; between two of them the limit is
    solved for, and the interval is where the share is not told from what is asked. A window of rattling narrower than a
    step of that scan can be missed: `between` makes it finer.

    Parameters
    ----------
    given : Mapping[str, Any]
        Its other numbers by name, delta, epsilon, beta and what a model adds, or those of a `Machine` with rpm; what a
        drawing says of the number itself is passed over.

    Returns
    -------
    Limit
        In the number's unit, with a 95 % interval.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    solver = _Solver(given, of, share, between, count, seed, budget)
    return solver.solved()


def design_limits(
    given: Mapping[str, Any], of: str, over: str, values: Iterable[float], share: float = 0.99, **more: Any
) -> list[Limit]:
    """Return the limit of one number as a curve over another, at these values of it.

    Other arguments are those of `design_limit`.

    Returns
    -------
    list[Limit]
        In the order of the values.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    require(over != of, f"a limit of {of} is over another number")
    return [design_limit({**given, over: value}, of, share, **more) for value in values]


def is_order(name: str) -> bool:
    """Return whether a number is the amplitude of an order, harmonic_20 or error_20."""
    return bool(HARMONIC.fullmatch(name) or ERROR.fullmatch(name))


def is_safe_if_small(name: str) -> bool:
    """Return whether small values of a number are the safe ones."""
    return SAFE_IF_SMALL.get(name, True)


def cannot_rest(at: Parameters) -> bool:
    """Return whether teeth of a gear of any forcing cannot stay together: ε is at its quiet limit or above."""
    return gear_at(at).quiet_limit <= float(at.epsilon[0])


class Excess(NamedTuple):
    """A share of quiet runs less what is asked: as found, and at both ends of its interval."""

    value: float
    low: float
    high: float


class _Solver:
    """The solver of one limit: shares by value, each computed once."""

    def __init__(
        self,
        given: Mapping[str, Any],
        of: str,
        share: float,
        between: tuple[float, float] | None,
        count: int,
        seed: int,
        budget: int,
    ) -> None:
        if not is_order(of):
            require_one_of("of", of, SAFE_IF_SMALL)
        self.share = require_number("share", share, positive=True)
        require(share <= MOST_SHARE, f"share must be at most {MOST_SHARE}, got {share:g}: no sample tells more")
        self.count = require_integer("count", count, 1, MOST_COUNT)
        self.seed, self.budget = (
            require_integer("seed", seed, 0, LARGEST_SEED),
            require_integer("budget", budget, 1, LARGEST_BUDGET),
        )
        fewest = math.ceil(4.0 * share / (1.0 - share))
        require(count >= fewest, f"{count} samples cannot tell a share of {share:g}: let count be {fewest} or more")
        self.of = of
        self.given = {name: value for name, value in given.items() if value is not None and name != of}
        one = between[0] if between else 1.0
        require_known({**self.given, of: one})
        for name, value in self.given.items():
            if name != "drive":
                require_number(name, value)
        low, high = self._range() if between is None else require_pair("between", between)
        require(0.0 <= low < high, f"between must be two numbers, the first below the second, got {low:g} and {high:g}")
        require(low > 0.0 or self.from_zero, f"{of} must be above 0: begin the range there")
        even = self.from_zero
        scanned = np.linspace(low, high, SCANNED + 1)[1:] if even else np.geomspace(low, high, SCANNED)
        self.scanned = scanned if is_safe_if_small(of) else scanned[::-1]
        self._require_machine()
        self.known: dict[tuple[float, int | None], Excess] = {}

    def _range(self) -> tuple[float, float]:
        """Return the range of values: from the safe end to where nothing is quiet, or SPAN times about the damping."""
        of, given = self.of, self.given
        if of == "restitution":
            return 0.0, 1.0
        if of in ("load", "load_torque"):
            drag = given["drag"] * given["rpm"] * RPM if of == "load_torque" else 1.0
            edge = self._edge(drag)
            return (0.99 * edge if self._is_beyond(0.98 * edge) else edge / SPAN), edge * SPAN
        if of not in OF_ONE_COSINE or self._is_inelastic():
            if of in FROM_ZERO or is_order(of):
                unit = self._widest() if is_machine({**given, of: 0.0}) else 1.0
                return 0.0, min(self._edge(unit), self._widest())
            if of in ("rpm", "delta", "drag"):
                edge = self._edge(1.0)
                least, most = edge / SPAN, edge * SPAN
                return (least, min(edge, IMPOSSIBLE / (given["radius"] * RPM))) if of == "rpm" else (0.99 * edge, most)
        if of in ("epsilon", "eccentricity"):
            points = points_of({**given, of: 0.0})
            unit = 1.0 if points.units is None else points.units.length
            return 0.0, min(float(np.ravel(quiet_limit(points.parameters.delta))[0] * unit), self._widest())
        if of in ("beta", "backlash"):
            points = points_of({**given, of: 1.0})
            unit = 1.0 if points.units is None else 2.0 * points.units.length
            least = float(np.ravel(points.parameters.delta)[0]) * unit / SPAN
            return least, min(least * SPAN * SPAN, self._widest())
        points = points_of({**given, of: 1.0})
        epsilon = float(np.ravel(points.parameters.epsilon)[0])
        require(epsilon > 0.0, "without an eccentricity everything is quiet: give one")
        end = float(np.ravel(points.parameters.delta)[0]) / least_damping(epsilon)
        if of == "rpm":
            return end / SPAN, min(end, IMPOSSIBLE / (given["radius"] * RPM))
        return 1.0 / end, SPAN / end

    def _is_inelastic(self) -> bool:
        return model_of_numbers({**self.given, self.of: 0.5}) is Inelastic

    @property
    def from_zero(self) -> bool:
        """True if it may be 0."""
        return self.of in FROM_ZERO or is_order(self.of)

    def _is_beyond(self, value: float) -> bool:
        """Return whether teeth cannot stay together at a value: the force between them changes its sign."""
        ((_, few),) = points_of({**self.given, self.of: np.array([value])}).by_shape()
        return cannot_rest(few.parameters)

    def _edge(self, unit: float) -> float:
        """Return the value, of a number that has a unit like this, at which teeth can just stay together."""
        safe = is_safe_if_small(self.of)
        values = unit * np.geomspace(1e-9, 1e9, 181)
        beyond = np.array([self._is_beyond(float(value)) for value in values])
        if not beyond.any():
            return unit
        last = int(np.argmax(beyond)) if safe else int(np.argmin(beyond))
        require(last > 0, f"teeth cannot stay together at any {self.of}: make an eccentricity or an error smaller")
        low, high = float(values[last - 1]), float(values[last])
        for _ in range(40):
            middle = math.sqrt(low * high)
            low, high = (low, middle) if self._is_beyond(middle) == safe else (middle, high)
        return high

    def _widest(self) -> float:
        """Return the widest backlash or eccentricity of a machine."""
        return float(WIDEST * self.given.get("radius", math.inf))

    def _require_machine(self) -> None:
        """Raise ParameterError on numbers of a machine that can only be in other units."""
        if is_machine({self.of: 0.0, **self.given}):
            for value in (self.scanned.min(), self.scanned.max()):
                machine_of({**self.given, self.of: float(value)})

    def ended(self, value: float, count: int) -> tuple[int, int]:
        """Return the samples, of so many, that end quietly, and those that may.

        The latter are undecided ones, if there is a quiet motion.

        Returns
        -------
        tuple[int, int]
            Both numbers.
        """
        points = points_of({**self.given, self.of: np.array([value])})
        at = points.parameters
        if Capability.CLOSED_FORM in MODELS[at.model].has and not np.all(at.epsilon < quiet_limit(at.delta)):
            return 0, 0
        ((_, points),) = points.by_shape()
        at = points.parameters
        if at.model == Inelastic.name and cannot_rest(at):
            return 0, 0
        nothing = np.zeros(1)
        tau, v = initial_conditions(nothing, nothing, nothing, count, 1.0, self.seed)
        speeds = sampled_speeds(NATURAL, at.delta, at.epsilon, at.beta)
        table, row, _cells, _how = follow_gears(points, tau, v * speeds[:, None], self.budget)
        kind = table.kind[row]
        return int((kind == Outcome.QUIET).sum()), int((kind == Outcome.UNDECIDED).sum())

    def excess(self, value: float, count: int | None = None) -> Excess:
        """Return the excess of the share of quiet runs over the required one, and at both ends of its interval."""
        if (known := self.known.get((value, count))) is None:
            samples = count or self.count
            quiet, undecided = self.ended(value, samples)
            (low, _), (_, high) = wilson_interval(quiet, samples), wilson_interval(quiet + undecided, samples)
            found = np.array([quiet / samples, low, high]) - self.share
            known = self.known[value, count] = Excess(*map(float, found))
        return known

    def solved(self) -> Limit:
        """Return the limit, and the ends of its interval."""
        last = self._first_too_much()
        (inside, outside), (sure, _), (_, possible) = (self._crossing(which, last) for which in Excess._fields)
        low, high = (sure, possible) if is_safe_if_small(self.of) else (possible, sure)
        return Limit(0.5 * (inside + outside), low, high)

    def _first_too_much(self) -> int:
        """Return the index of the first value that is too much, by the scan's samples if these are sure, else by all.

        Returns
        -------
        int
            The number of values where none is too much.
        """
        for i, value in enumerate(self.scanned):
            few = self.excess(float(value), FEW) if self.count > FEW else self.excess(float(value))
            if few.high < 0.0 or (few.value < 0.0 and self.excess(float(value)).value < 0.0):
                return i
        return self.scanned.size

    def _crossing(self, which: str, near: int) -> tuple[float, float]:
        """Two values that are CLOSE, between which this excess falls below 0; both NaN if there are none."""

        def positive(i: int) -> bool:
            if i < 0:
                return self.of in ("epsilon", "eccentricity") and not self._is_inelastic()  # without, all is quiet
            return bool(getattr(self.excess(float(self.scanned[i])), which) >= 0.0)

        after = near
        while after > 0 and not positive(after - 1):
            after -= 1
        while after < self.scanned.size and positive(after):
            after += 1
        if after == self.scanned.size or (after == 0 and not positive(-1)):
            return math.nan, math.nan
        inside, outside = float(self.scanned[after - 1]) if after else 0.0, float(self.scanned[after])
        step = abs(outside - inside)
        while abs(outside - inside) > CLOSE * step:
            middle = 0.5 * (inside + outside)
            if getattr(self.excess(middle), which) >= 0.0:
                inside = middle
            else:
                outside = middle
        return inside, outside
