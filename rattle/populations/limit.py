"""Design limits: the value of one number of a gear up to which the gear runs quietly with a required probability."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from rattle.attractors.classify import BUDGET
from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import LARGEST_BUDGET, NATURAL, highest_sampled_speeds
from rattle.errors import require, require_integer, require_number, require_one_of, require_pair
from rattle.flight.forcing import damping_at_quiet_limit
from rattle.impacting.orbits.limits import quiet_limit
from rattle.machine.forcing import AMPLITUDES
from rattle.machine.given import IMPOSSIBLE, RPM, WIDEST
from rattle.models import MODELS, Capability, Inelastic, gear_at_point
from rattle.numerics.sampling import initial_conditions, wilson_interval
from rattle.parameters import Parameters
from rattle.populations.gears import follow_gears
from rattle.populations.plan import LARGEST_SEED, MOST_SHARE
from rattle.populations.tolerances import (
    ERROR,
    HARMONIC,
    gear_points_of_numbers,
    is_machine,
    machine_from_numbers,
    model_of_numbers,
    require_known_names,
)

#: {name of a number that has a design limit: True if its small values are safe, False if its large values are safe}.
SAFE_IF_SMALL = {
    **dict.fromkeys(("epsilon", "eccentricity", "beta", "backlash", "rpm"), True),
    **dict.fromkeys(("restitution", *AMPLITUDES), True),
    **dict.fromkeys(("delta", "drag", "load", "load_torque"), False),
}
#: Numbers whose default range of values follows from closed forms. The inelastic model, the only one with harmonics, is
#: an exception: in this model most of these ranges are found by a search.
OF_ONE_COSINE = ("epsilon", "eccentricity", "beta", "backlash", "rpm", "delta", "drag")
#: The numbers whose range starts at 0, besides amplitudes with an order, such as error_12. Values of numbers whose
#: range starts at 0 are scanned in equal steps, values of other numbers in equal ratios.
FROM_ZERO = ("epsilon", "eccentricity", "restitution", *AMPLITUDES)
#: Number of values of a scan.
SCANNED_VALUES = 32
#: Number of samples that are followed first at each value of a scan.
FIRST_SAMPLES = 256
#: Largest allowed number of samples at a value.
MOST_COUNT = 65_536
#: If nothing in the model determines an end of a default range, the end is a typical value, or the other end, divided
#: or multiplied by this factor.
RANGE_RATIO = 100.0
#: Accuracy with which a limit is solved for, as a fraction of a step of the scan.
ACCURACY = 2.0**-8


class Limit(NamedTuple):
    """The design limit of a number, in the unit of the number, with its 95 % interval.

    The value, or an end of the interval, is NaN if it lies outside the scanned range. Then the gear is not quiet often
    enough at the first value of the scan, or still quiet often enough at the last value.
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
    """Return the design limit of a number: its last value, coming from safe values, at which a gear runs quietly.

    The probability is at least `share` at the limit and at all safer values. The limit is the largest epsilon, beta or
    restitution, or the least delta or load. For a machine it is the largest eccentricity, mesh_error or other
    amplitude, backlash or rpm, or the least drag or load_torque. harmonic_20 is the amplitude of order 20 over that of
    the first harmonic; error_20 is the amplitude of order 20 of a machine in m.

    The probability is estimated from `count` states in [0, 1) × (0, natural speed), the same for all values. A scan of
    32 values starts at the safe end. The limit is solved for between two of these values; the interval contains the
    values at which the share of quiet runs does not differ significantly from `share`. A range of rattling narrower
    than a step of the scan can be missed; a smaller range `between` makes the steps finer.

    Parameters
    ----------
    given : Mapping[str, Any]
        The other numbers of the gear by name: delta, epsilon, beta and the parameters that a model adds; or the numbers
        of a `Machine` with rpm. An entry for the number `of` itself is ignored.
    of : str
        The name of the number whose limit is computed.
    share : float
        The required probability.
    between : tuple[float, float] | None
        The range of the scan (least, largest); by default from safe values to values at which no motion is quiet.
    count, seed : int
        The number of states, and their seed.
    budget : int
        Impacts on Σ⁺ after which a sample that reached no attractor is undecided.

    Returns
    -------
    Limit
        The limit in the unit of the number, with its 95 % interval.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    solver = _LimitSolver(given, of, share, between, count, seed, budget)
    return solver.solve()


def design_limits(
    given: Mapping[str, Any], of: str, over: str, values: Iterable[float], share: float = 0.99, **more: Any
) -> list[Limit]:
    """Return the design limits of one number of a gear, for each of several values of another number.

    of: the name of the number whose limit is sought. over: the name of the other number, which takes the `values`. The
    other arguments are those of `design_limit`.

    Returns
    -------
    list[Limit]
        The limits, in the order of the values.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    require(over != of, f"`over` must name another number of the gear than `of`, got {of} for both")
    return [design_limit({**given, over: value}, of, share, **more) for value in values]


def is_amplitude_with_order(name: str) -> bool:
    """Return whether this is the name of an amplitude of one order, such as harmonic_20 or error_20."""
    return bool(HARMONIC.fullmatch(name) or ERROR.fullmatch(name))


def is_safe_if_small(name: str) -> bool:
    """Return whether small values of the number with this name make a gear run quietly, not large values."""
    return SAFE_IF_SMALL.get(name, True)


def is_beyond_quiet_limit(at: Parameters) -> bool:
    """Return whether the teeth cannot stay in contact, because ε of the gear (1,) is at its quiet limit or above."""
    return gear_at_point(at).quiet_limit <= float(at.epsilon[0])


class ShareExcess(NamedTuple):
    """The share of quiet runs minus the required share: an estimate, and both ends of its 95 % interval."""

    value: float
    low: float
    high: float


class _LimitSolver:
    """The solver of one design limit. It remembers the share of quiet runs at each value that it has computed."""

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
        if not is_amplitude_with_order(of):
            require_one_of("of", of, SAFE_IF_SMALL)
        self.share = require_number("share", share, positive=True)
        require(
            share <= MOST_SHARE,
            f"share must be at most {MOST_SHARE}, got {share:g}: no sample is large enough for more",
        )
        self.count = require_integer("count", count, 1, MOST_COUNT)
        self.seed, self.budget = (
            require_integer("seed", seed, 0, LARGEST_SEED),
            require_integer("budget", budget, 1, LARGEST_BUDGET),
        )
        fewest = math.ceil(4.0 * share / (1.0 - share))
        require(
            count >= fewest, f"{count} samples are too few for a share of {share:g}: give a count of {fewest} or more"
        )
        self.of = of
        self.given = {name: value for name, value in given.items() if value is not None and name != of}
        one = between[0] if between else 1.0
        require_known_names({**self.given, of: one})
        for name, value in self.given.items():
            if name != "drive":
                require_number(name, value)
        low, high = self._default_range() if between is None else require_pair("between", between)
        require(0.0 <= low < high, f"between must be (low, high) with 0 <= low < high, got {low:g} and {high:g}")
        require(low > 0.0 or self.starts_at_zero, f"{of} must be above 0: let `between` start above 0")
        even = self.starts_at_zero
        scanned = np.linspace(low, high, SCANNED_VALUES + 1)[1:] if even else np.geomspace(low, high, SCANNED_VALUES)
        self.scanned_values = scanned if is_safe_if_small(of) else scanned[::-1]
        self._require_plausible_machine()
        self.known_excesses: dict[tuple[float, int | None], ShareExcess] = {}

    def _default_range(self) -> tuple[float, float]:
        """Return the default range of the scan, which goes from a safe end of the range to an unsafe end.

        For most numbers the unsafe end is the value beyond which the teeth cannot stay in contact, or the largest
        allowed value if the scan comes to it first. The safe end is 0 if the scan can start at 0 (`starts_at_zero`). An
        end without such a value is a typical value, or the other end, divided or multiplied by RANGE_RATIO.

        Returns
        -------
        tuple[float, float]
            The least and the largest value.
        """
        of, given = self.of, self.given
        if of == "restitution":
            return 0.0, 1.0
        if of in ("load", "load_torque"):
            drag = given["drag"] * given["rpm"] * RPM if of == "load_torque" else 1.0
            edge = self._last_value_with_contact(drag)
            return (0.99 * edge if self._is_contact_impossible(0.98 * edge) else edge / RANGE_RATIO), edge * RANGE_RATIO
        if of not in OF_ONE_COSINE or self._is_inelastic():
            if of in FROM_ZERO or is_amplitude_with_order(of):
                unit = self._largest_allowed_length() if is_machine({**given, of: 0.0}) else 1.0
                return 0.0, min(self._last_value_with_contact(unit), self._largest_allowed_length())
            if of in ("rpm", "delta", "drag"):
                edge = self._last_value_with_contact(1.0)
                least, most = edge / RANGE_RATIO, edge * RANGE_RATIO
                return (least, min(edge, IMPOSSIBLE / (given["radius"] * RPM))) if of == "rpm" else (0.99 * edge, most)
        if of in ("epsilon", "eccentricity"):
            points = gear_points_of_numbers({**given, of: 0.0})
            unit = 1.0 if points.units is None else points.units.length
            return 0.0, min(
                float(np.ravel(quiet_limit(points.parameters.delta))[0] * unit), self._largest_allowed_length()
            )
        if of in ("beta", "backlash"):
            points = gear_points_of_numbers({**given, of: 1.0})
            unit = 1.0 if points.units is None else 2.0 * points.units.length
            least = float(np.ravel(points.parameters.delta)[0]) * unit / RANGE_RATIO
            return least, min(least * RANGE_RATIO * RANGE_RATIO, self._largest_allowed_length())
        points = gear_points_of_numbers({**given, of: 1.0})
        epsilon = float(np.ravel(points.parameters.epsilon)[0])
        require(epsilon > 0.0, "without an eccentricity all motions become quiet: give an eccentricity above 0")
        end = float(np.ravel(points.parameters.delta)[0]) / damping_at_quiet_limit(epsilon)
        if of == "rpm":
            return end / RANGE_RATIO, min(end, IMPOSSIBLE / (given["radius"] * RPM))
        return 1.0 / end, RANGE_RATIO / end

    def _is_inelastic(self) -> bool:
        """Return whether the gear's model is the inelastic one, judged by the names of its given and sought numbers."""
        return model_of_numbers({**self.given, self.of: 0.5}) is Inelastic

    @property
    def starts_at_zero(self) -> bool:
        """True if the default range of the number whose limit is sought starts at 0."""
        return self.of in FROM_ZERO or is_amplitude_with_order(self.of)

    def _is_contact_impossible(self, value: float) -> bool:
        """Return whether the teeth cannot stay in contact at this value of the number whose limit is sought."""
        ((_, few),) = gear_points_of_numbers({**self.given, self.of: np.array([value])}).group_by_harmonics()
        return is_beyond_quiet_limit(few.parameters)

    def _last_value_with_contact(self, unit: float) -> float:
        """Return the value of the sought number beyond which the teeth cannot stay in contact.

        unit: a typical value of the number. It is returned if the teeth can stay in contact at all values.

        Returns
        -------
        float
            The value.

        Raises
        ------
        ParameterError
            If the teeth cannot stay in contact at any value.
        """
        safe = is_safe_if_small(self.of)
        values = unit * np.geomspace(1e-9, 1e9, 181)
        beyond = np.array([self._is_contact_impossible(float(value)) for value in values])
        if not beyond.any():
            return unit
        last = int(np.argmax(beyond)) if safe else int(np.argmin(beyond))
        impossible = f"the teeth cannot stay in contact at any {self.of}: make the eccentricity or an error smaller"
        require(last > 0, impossible)
        low, high = float(values[last - 1]), float(values[last])
        for _ in range(40):
            middle = math.sqrt(low * high)
            low, high = (low, middle) if self._is_contact_impossible(middle) == safe else (middle, high)
        return high

    def _largest_allowed_length(self) -> float:
        """Return the largest allowed backlash or amplitude in m if the gear is a machine, else infinity."""
        return float(WIDEST * self.given.get("radius", math.inf))

    def _require_plausible_machine(self) -> None:
        """Raise ParameterError if a machine at an end of the scan has a number so large that its unit must be wrong."""
        if is_machine({self.of: 0.0, **self.given}):
            for value in (self.scanned_values.min(), self.scanned_values.max()):
                machine_from_numbers({**self.given, self.of: float(value)})

    def count_quiet_and_undecided(self, value: float, count: int) -> tuple[int, int]:
        """Follow `count` samples at a value of the sought number, and count the quiet and the undecided samples.

        Returns
        -------
        tuple[int, int]
            The numbers of quiet and of undecided samples. If rigid teeth cannot stay in contact at the value, no sample
            is followed and both are 0.
        """
        points = gear_points_of_numbers({**self.given, self.of: np.array([value])})
        at = points.parameters
        if Capability.CLOSED_FORM in MODELS[at.model].has and not np.all(at.epsilon < quiet_limit(at.delta)):
            return 0, 0
        ((_, points),) = points.group_by_harmonics()
        at = points.parameters
        if at.model == Inelastic.name and is_beyond_quiet_limit(at):
            return 0, 0
        nothing = np.zeros(1)
        tau, v = initial_conditions(nothing, nothing, nothing, count, 1.0, self.seed)
        speeds = highest_sampled_speeds(NATURAL, at.delta, at.epsilon, at.beta)
        table, row, _cells, _how = follow_gears(points, tau, v * speeds[:, None], self.budget)
        kind = table.kind[row]
        return int((kind == Outcome.QUIET).sum()), int((kind == Outcome.UNDECIDED).sum())

    def share_excess(self, value: float, count: int | None = None) -> ShareExcess:
        """Return the share of quiet runs at a value of the sought number, minus the required share.

        count: the number of samples that are followed; None means all samples.

        Returns
        -------
        ShareExcess
            The difference with its interval. It is computed once for each value and count.
        """
        if (known := self.known_excesses.get((value, count))) is None:
            samples = count or self.count
            quiet, undecided = self.count_quiet_and_undecided(value, samples)
            (low, _), (_, high) = wilson_interval(quiet, samples), wilson_interval(quiet + undecided, samples)
            found = np.array([quiet / samples, low, high]) - self.share
            known = self.known_excesses[value, count] = ShareExcess(*map(float, found))
        return known

    def solve(self) -> Limit:
        """Solve for the limit and the ends of its 95 % interval."""
        last = self._first_unsafe_index()
        (inside, outside), (sure, _), (_, possible) = (
            self._bracket_of_crossing(which, last) for which in ShareExcess._fields
        )
        low, high = (sure, possible) if is_safe_if_small(self.of) else (possible, sure)
        return Limit(0.5 * (inside + outside), low, high)

    def _first_unsafe_index(self) -> int:
        """Return the index of the first value of the scan at which the share of quiet runs is too small.

        At each value FIRST_SAMPLES samples are followed first. If their share of quiet runs is at least the required
        share, the value is safe; if it is significantly below the required share, the value is unsafe. Otherwise all
        samples are followed, and the value is safe if their share is at least the required one.

        Returns
        -------
        int
            The index; it is the number of values if all shares are large enough.
        """
        for i, value in enumerate(self.scanned_values):
            few = (
                self.share_excess(float(value), FIRST_SAMPLES)
                if self.count > FIRST_SAMPLES
                else self.share_excess(float(value))
            )
            if few.high < 0.0 or (few.value < 0.0 and self.share_excess(float(value)).value < 0.0):
                return i
        return self.scanned_values.size

    def _bracket_of_crossing(self, which: str, near: int) -> tuple[float, float]:
        """Return two values, at most ACCURACY scan steps apart, between which a field of `ShareExcess` falls below 0.

        which: the name of the field. near: the index in the scan at which the search starts. Both values are NaN if the
        field does not fall below 0 within the scan.

        Returns
        -------
        tuple[float, float]
            The value on the safe side, and the value on the other side.
        """

        def is_nonnegative(i: int) -> bool:
            """Return whether field `which` of the excess is at least 0 at value i of the scan, or at 0 if i is −1."""
            # The scan does not include 0. A gear that is not inelastic has no forcing at eccentricity 0, so that all of
            # its motions become quiet. For an inelastic gear or any other number, nothing is known about the value 0.
            if i < 0:
                return self.of in ("epsilon", "eccentricity") and not self._is_inelastic()
            return bool(getattr(self.share_excess(float(self.scanned_values[i])), which) >= 0.0)

        after = near
        while after > 0 and not is_nonnegative(after - 1):
            after -= 1
        while after < self.scanned_values.size and is_nonnegative(after):
            after += 1
        if after == self.scanned_values.size or (after == 0 and not is_nonnegative(-1)):
            return math.nan, math.nan
        inside, outside = float(self.scanned_values[after - 1]) if after else 0.0, float(self.scanned_values[after])
        step = abs(outside - inside)
        while abs(outside - inside) > ACCURACY * step:
            middle = 0.5 * (inside + outside)
            if getattr(self.share_excess(middle), which) >= 0.0:
                inside = middle
            else:
                outside = middle
        return inside, outside
