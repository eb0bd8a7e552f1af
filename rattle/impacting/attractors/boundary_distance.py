"""Compute the boundary distance of quiet motion: the least speed after an impact that leads to another attractor.

Quiet motion is the line v = 0 of all phases τ, so the distance is the least v of all states that do not become quiet.
It is computed in four steps. The classifier of `rattle.attractors.table` first decides a set of states (τ, v) with
v ≤ v_max: half of them uniform in v, half uniform in ln v, so that slow states are well represented. Then preimages of
the basins that this set found are computed, because all preimages of a basin belong to the basin, however thin they
are. Further sets of states, uniform in ln v, cover the strip between the capture speed and the least speed found so
far. Finally a pattern search starts from the slowest states found. Every state that counts was itself followed to its
attractor.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import MOST_SAMPLES, SpeedLimit, highest_sampled_speeds
from rattle.errors import broadcast_parameters, require
from rattle.flight.first_impact import OK
from rattle.flight.law import wrap_phase_difference
from rattle.impacting.attractors.classifier import ImpactingClassifier
from rattle.impacting.map.impact_map import apply_inverse_impact_map
from rattle.impacting.map.quiet import LONGEST_REST, becomes_quiet_late, capture_speeds, most_impacts_until_quiet
from rattle.impacting.orbits.limits import quiet_limit
from rattle.numerics.compile import kernel
from rattle.numerics.sampling import sobol_points
from rattle.orbits.iterates import fold_phases
from rattle.parameters import Parameters

# SAMPLED: number of states in each set drawn uniformly in v or in ln v. ROUNDS: largest number of sets after the first.
# The states of these later sets are slower than the slowest state that was known to end quiet motion.
SAMPLED, ROUNDS = 1024, 8
# number of states at the edges of all capture regions of a cell; fewest and most states at the edge of one region
EDGES, FEWEST_EDGES, MOST_EDGES = 512, 8, 64
# at strong damping, largest number of impacts over which a state is followed backwards; speed, in natural speeds, above
# which a state is not followed backwards any further
PREIMAGES, CEILING = 64, 25.0 / 7.0
# largest number of states of a cell, with their copies, whose preimages are computed; number of copies near each state;
# largest distance of these copies, in τ and relative in v
STATES, COPIES, NEAR = 1024, 3, 1.0 / 64.0
TRIED_PREIMAGES = 64  # number of preimages in each cell, the slowest ones, that are followed to their attractors
# number of pattern searches of a cell; least phase difference between the states at which they begin
STARTS, APART = 4, 1.0 / 32.0
# offsets of the states of a pattern in τ and in v, in units of the pattern's size; the offsets in v include very small
# ones, because the boundary is flat near a smooth minimum
TAU_OFFSETS, V_OFFSETS = 8.0 ** -np.arange(3), 8.0 ** -np.arange(5)
# first and last size of a pattern, relative in v and in forcing periods in τ
FIRST_SCALE, LAST_SCALE = 2.0**-4, 2.0**-20
# SHRINK: factor by which a pattern shrinks if none of its states is slower. MOST_LAG: a search is given up if its least
# speed exceeds the least speed found in the cell by more than this many sizes of the pattern.
SHRINK, MOST_LAG = 1.0 / 16.0, 8.0
MOST_PATTERNS = 60  # most patterns of one search
# least and largest limit of impacts at strong damping for states after the first set; at weaker damping both limits are
# `impact_limit_factor` times as large
LEAST_IMPACTS, MOST_IMPACTS = 512, 4096
# States after the first set are followed for at most this factor times the largest number of impacts that a state of
# the first set took to settle. A state has settled when it has reached a periodic orbit. In cells whose unresolved
# samples count as chaotic, a state has also settled when it has become quiet.
LIMIT_MULTIPLE = 2
# at the end the slowest states that seem chaotic are followed for this many times the cell's limit of impacts
CONFIRMING_FACTOR = 8
# states that are drawn uniformly in ln v have at least the capture speed, and at least this share of the natural speed
LOWEST = 1e-6 / 7.0

Array = NDArray[np.float64]


class BoundaryDistance(NamedTuple):
    """The least impact speed that ends quiet motion, as floats for one gear or arrays for many cells.

    Attributes
    ----------
    v
        The least speed. It is inf if no state up to v_max reaches another attractor, and 0 if there is no quiet motion.
        It is NaN if all states that do not become quiet are undecided. It is also NaN, with undecided = 0, if becoming
        quiet takes more impacts than the limit, as happens within a few per cent of the quiet limit (in a wider range
        at weak damping): then a high number of impacts does not distinguish quiet motion from chaos.
    tau
        The phase of the impact; NaN if v is 0, inf or NaN.
    undecided
        The least speed of an undecided state, inf if there is none. If it is below v, the true distance may be below v.
    """

    v: Any
    tau: Any
    undecided: Any


class _QuietCells:
    """n cells that have quiet motion, their classifier, and the slowest states found that leave quiet motion.

    Attributes
    ----------
    is_unresolved_chaotic : flags (n,)
        True if the unresolved samples of the cell count as chaotic.
    impact_limits : (n,)
        Largest number of impacts for which a state is followed.
    tau, v : (n, STARTS)
        The slowest states found that reach an attractor other than quiet motion. If fewer than STARTS are found, the
        other entries of v are inf.
    least_undecided_speed : (n,)
        The least speed of an undecided state.
    """

    def __init__(self, delta: Array, epsilon: Array, beta: Array, v_max: Array) -> None:
        n = delta.size
        usual = highest_sampled_speeds(None, delta, epsilon, beta)
        # least speed of the states that are drawn uniformly in ln v: the capture speed, but at least LOWEST times the
        # natural speed
        self.least_drawn_speeds = np.clip(capture_speeds(delta, epsilon, beta), LOWEST * usual, 0.5 * v_max)
        self.v_max, self.highest_preimage_speeds = v_max, CEILING * usual
        # factors by which the cells' limits of impacts are larger than at strong damping
        self.impact_limit_factor = most_impacts_until_quiet(delta) / LONGEST_REST
        self.tau, self.v = np.full((n, STARTS), np.nan), np.full((n, STARTS), np.inf)
        self.n_used_capture_regions = np.zeros(
            n, np.int64
        )  # number of the cell's capture regions whose preimages are already computed
        self.first_states = self.draw_first_states(n)
        tau, v = (each.copy() for each in self.first_states)
        at = Parameters(ImpactingClassifier.model, delta, epsilon, beta)
        self.classifier = ImpactingClassifier.classify(at, tau, v)
        status, impacts = self.classifier.status, self.classifier.impacts
        self.is_unresolved_chaotic = np.array([cell in self.classifier.chaotic_sets for cell in range(n)])
        settled = np.where((status == Outcome.PERIODIC) | (status == Outcome.QUIET), impacts, 0).max(axis=1)
        most = MOST_IMPACTS * self.impact_limit_factor
        # if LIMIT_MULTIPLE times the impacts that samples take to settle exceed the largest limit, unresolved samples
        # may still become quiet, so they do not count as chaotic
        self.is_unresolved_chaotic &= LIMIT_MULTIPLE * settled <= most
        captured = np.where(status == Outcome.PERIODIC, impacts, 0).max(axis=1)
        self.impact_limits = np.clip(
            LIMIT_MULTIPLE * np.where(self.is_unresolved_chaotic, settled, captured),
            LEAST_IMPACTS * self.impact_limit_factor,
            most,
        )
        self.impact_limits = self.impact_limits.astype(np.int64)
        self.least_undecided_speed = np.full(n, np.inf)

    def draw_first_states(self, n: int) -> tuple[Array, Array]:
        """Return τ and v (n, 2 · SAMPLED) of the states to classify first: half uniform in ln v, half uniform in v."""
        (tau, v), (x, y) = self.draw_states_in_strip(self.v_max, 0), sobol_points(SAMPLED).T
        plane = self.v_max[:, None] * (y + 0.5 / SAMPLED)
        return np.hstack([tau, np.tile(x, (n, 1))]), np.hstack([v, plane])

    def keep_first_states(self) -> None:
        """Keep the slowest of the first states that leave quiet motion, and the slowest of their preimages."""
        (tau, v), status = self.first_states, self.classifier.status
        away = (status == Outcome.PERIODIC) | ((status == Outcome.UNRESOLVED) & self.is_unresolved_chaotic[:, None])
        self.least_undecided_speed = np.where((status != Outcome.QUIET) & ~away, v, np.inf).min(axis=1)
        self.keep_slowest(tau, np.where(away, v, np.inf))
        self.keep_preimages(away, tau, v)

    def draw_states_in_strip(self, below: Array, i: int) -> tuple[Array, Array]:
        """Return τ and v (n, SAMPLED) of set number i of states (Sobol points), uniform in τ and in ln v.

        The speeds of each cell lie between the cell's entries of `self.least_drawn_speeds` and of `below` (n,).

        Returns
        -------
        tuple[Array, Array]
            τ and v.
        """
        x, y = sobol_points((i + 1) * SAMPLED)[i * SAMPLED :].T
        low, high = (
            np.log(self.least_drawn_speeds)[:, None],
            np.log(np.maximum(below, self.least_drawn_speeds))[:, None],
        )
        return np.repeat(x[None], below.size, axis=0), np.exp(low + (high - low) * y)

    def flag_states_leaving_quiet(
        self, cell: NDArray[np.int64], tau: Array, v: Array, times: int = 1
    ) -> NDArray[np.bool_]:
        """Return whether states (k,) of these cells (k,) reach an attractor other than quiet motion.

        Each state is followed for `times` times the limit of impacts of its cell. A state that reaches no attractor by
        then counts as chaotic if the cell's entry of `is_unresolved_chaotic` is True, otherwise as undecided.

        Returns
        -------
        NDArray[np.bool_]
            (k,), False for states that become quiet or stay undecided.
        """
        status = self.classifier.outcomes_of_states(cell, tau, v, times * self.impact_limits[cell])
        return (status == Outcome.PERIODIC) | ((status == Outcome.UNRESOLVED) & self.is_unresolved_chaotic[cell])

    def keep_slowest(self, tau: Array, v: Array) -> None:
        """Add new states (n, k), and keep the STARTS slowest states of each cell whose phases are at least APART apart.

        v = inf means no state.
        """
        tau, v = np.append(self.tau, tau, axis=1), np.append(self.v, v, axis=1)
        for i in range(STARTS):
            each, one = np.arange(v.shape[0]), np.argmin(v, axis=1)
            self.tau[:, i], self.v[:, i] = tau[each, one], v[each, one]
            v = np.where(np.abs(wrap_phase_difference(tau - self.tau[:, i, None])) < APART, np.inf, v)

    def states_at_edges_of_new_regions(self) -> tuple[NDArray[np.int64], Array, Array]:
        """Return states (cell, τ, v) at the edges of the capture regions that were found since the last call."""
        balls = self.classifier.balls
        cell, p = np.nonzero(
            (np.arange(balls.tau.shape[1]) >= self.n_used_capture_regions[:, None]) & (balls.orbit >= 0)
        )
        fresh = p < balls.n[cell]
        cell, p = cell[fresh], p[fresh]
        each = np.clip(EDGES // np.maximum(balls.n[cell], 1), FEWEST_EDGES, MOST_EDGES)
        angle = 2 * np.pi * (np.arange(each.sum()) - np.repeat(np.cumsum(each) - each, each)) / np.repeat(each, each)
        tau, v, a, b, d = (np.repeat(x[cell, p], each) for x in (balls.tau, balls.v, balls.c00, balls.c01, balls.c11))
        y = np.sin(angle) / np.sqrt(d - b * b / a)
        x = (np.cos(angle) - b / np.sqrt(a) * y) / np.sqrt(a)
        self.n_used_capture_regions = balls.n.copy()
        return np.repeat(cell, each), fold_phases(tau + x), v + y

    def keep_preimages(self, away: NDArray[np.bool_], tau: Array, v: Array) -> None:
        """Compute preimages of states that leave quiet motion, and keep the slowest that leave quiet motion too.

        tau, v (n, k): states of each cell. away (n, k): flags of the states that leave quiet motion. Each flagged state
        is used with COPIES slower states close to it. If this makes more than STATES in a cell, only every second,
        third, … flagged state of the cell is used. Preimages are also computed of states at the edges of the capture
        regions that were found since the last call.
        """
        number = away.sum(axis=1)[:, None]
        # every `every`-th flagged state of a cell is used, so that these states and their copies are at most STATES
        every = -(-number * (1 + COPIES) // STATES)
        some = np.flatnonzero(away & (np.cumsum(away, axis=1) % np.maximum(every, 1) == 0))
        near = sobol_points(1 + COPIES)[:, :, None] * NEAR
        near_tau, near_v = fold_phases(tau.flat[some] + near[:, 0]), v.flat[some] * (1.0 - near[:, 1])
        states = np.tile(some // v.shape[1], 1 + COPIES), near_tau.ravel(), near_v.ravel()
        cell, tau, v = (np.append(x, y) for x, y in zip(states, self.states_at_edges_of_new_regions(), strict=True))
        delta, epsilon, beta = (x[cell] for x in self.classifier.cells[:3])
        steps, ceiling = (
            (PREIMAGES * self.impact_limit_factor[cell]).astype(np.int64),
            self.highest_preimage_speeds[cell],
        )
        tau, v = slowest_preimages(tau, v, steps, ceiling, delta, epsilon, beta)
        order = np.lexsort((tau, v, cell))
        rank = np.arange(cell.size) - np.searchsorted(cell[order], cell[order])
        order, rank = order[rank < TRIED_PREIMAGES], rank[rank < TRIED_PREIMAGES]
        cell, tau, v = cell[order], tau[order], v[order]
        low = v < self.v_max[cell]
        low[low] = self.flag_states_leaving_quiet(cell[low], tau[low], v[low])
        found_tau, found = np.zeros((len(self.v), TRIED_PREIMAGES)), np.full((len(self.v), TRIED_PREIMAGES), np.inf)
        found_tau[cell, rank], found[cell, rank] = tau, np.where(low, v, np.inf)
        self.keep_slowest(found_tau, found)

    def search_below_least_speed(self) -> None:
        """Classify sets of states that are slower than the slowest state known to end quiet motion.

        The search of a cell ends after the first set that leads to no slower state, or after ROUNDS sets.
        """
        pending = np.arange(len(self.v))
        for i in range(1, ROUNDS + 1):
            if not pending.size:
                break
            before = self.v[:, 0].copy()
            tau, v = self.draw_states_in_strip(np.minimum(before, self.v_max), i)
            away = np.zeros(v.shape, np.bool_)
            cell = np.repeat(pending, SAMPLED)
            away[pending] = self.flag_states_leaving_quiet(cell, tau[pending].ravel(), v[pending].ravel()).reshape(
                -1, SAMPLED
            )
            self.keep_slowest(tau, np.where(away, v, np.inf))
            self.keep_preimages(away, tau, v)
            pending = pending[self.v[pending, 0] < before[pending]]

    def search_around_kept_states(self) -> None:
        """Search for slower states in a pattern around each kept state; a pattern without a slower state shrinks."""
        offset = np.concatenate([-TAU_OFFSETS, [0.0], TAU_OFFSETS[::-1]])
        sideways, down = (x.ravel() for x in np.meshgrid(offset, V_OFFSETS))
        cell = np.repeat(np.arange(len(self.v)), STARTS)
        best_tau, best, scale = self.tau.ravel(), self.v.ravel(), np.full(cell.size, FIRST_SCALE)
        for _ in range(MOST_PATTERNS):
            least = np.fmin.reduce(best.reshape(-1, STARTS), axis=1)[cell]
            hopeful = np.flatnonzero((scale > LAST_SCALE) & (best * (1.0 - MOST_LAG * scale) < least))
            if not hopeful.size:
                break
            tau = fold_phases(best_tau[hopeful, None] + scale[hopeful, None] * sideways)
            v = best[hopeful, None] * (1.0 - scale[hopeful, None] * down)
            away = self.flag_states_leaving_quiet(np.repeat(cell[hopeful], down.size), tau.ravel(), v.ravel()).reshape(
                v.shape
            )
            v = np.where(away, v, np.inf)
            each, one = np.arange(hopeful.size), np.argmin(v, axis=1)
            lower = np.isfinite(v[each, one])
            best[hopeful[lower]], best_tau[hopeful[lower]] = v[each, one][lower], tau[each, one][lower]
            scale[hopeful] *= np.where(lower, 1.0, SHRINK)
        self.tau, self.v = best_tau.reshape(-1, STARTS), best.reshape(-1, STARTS)

    def confirm_chaos(self) -> None:
        """Follow the slowest states for CONFIRMING_FACTOR times the cell's limit of impacts, if they count as chaotic.

        A state that becomes quiet in this longer time is dropped, and its speed counts as that of an undecided state:
        other states that seem chaotic may become quiet, too, if they are followed for longer.
        """
        row, column = np.nonzero(self.is_unresolved_chaotic[:, None] & np.isfinite(self.v))
        transient = ~self.flag_states_leaving_quiet(row, self.tau[row, column], self.v[row, column], CONFIRMING_FACTOR)
        row, column = row[transient], column[transient]
        np.minimum.at(self.least_undecided_speed, row, self.v[row, column])
        self.v[row, column] = np.inf


def boundary_distances(
    delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike = 0.6, v_max: SpeedLimit = None
) -> BoundaryDistance:
    """Return the least impact speeds that end quiet motion, for many cells; delta, epsilon and beta broadcast.

    The values of a cell equal those of `Gear.boundary_distance`, whatever the other cells are.

    Returns
    -------
    BoundaryDistance
        Arrays of the broadcast shape.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    broadcast = broadcast_parameters(delta, epsilon, beta)
    d, e, b = (np.array(x, order="C").ravel() for x in broadcast)
    most = 64 * MOST_SAMPLES // (STATES * (1 + COPIES))
    require(d.size <= most, f"{d.size:,} cells are too many at once: give at most {most:,}")
    highest = highest_sampled_speeds(v_max, d, e, b)
    found = BoundaryDistance(np.zeros(d.size), np.full(d.size, np.nan), np.full(d.size, np.inf))
    below = e < quiet_limit(d)
    late = below & becomes_quiet_late(d, e, b)
    found.v[late], found.undecided[late] = np.nan, 0.0
    quiet = np.flatnonzero(below & ~late)
    if quiet.size:
        cells = _QuietCells(d[quiet], e[quiet], b[quiet], highest[quiet])
        cells.keep_first_states()
        cells.search_below_least_speed()
        cells.search_around_kept_states()
        cells.confirm_chaos()
        one = np.argmin(cells.v, axis=1)[:, None]
        v = np.take_along_axis(cells.v, one, 1)[:, 0]
        found.v[quiet] = np.where(np.isfinite(v) | np.isinf(cells.least_undecided_speed), v, np.nan)
        found.tau[quiet] = np.where(np.isfinite(v), np.take_along_axis(cells.tau, one, 1)[:, 0], np.nan)
        found.undecided[quiet] = cells.least_undecided_speed
    return BoundaryDistance(*(x.reshape(np.shape(broadcast[0])) for x in found))


@kernel
def slowest_preimages(tau, v, steps, ceiling, delta, epsilon, beta):
    """Return for each state of flat arrays the slowest of its preimages Π⁻ᵏ, 0 ≤ k ≤ steps.

    A state is followed back no further than its first preimage with a speed above `highest_preimage_speeds`. All
    arguments are arrays of one length.

    Returns
    -------
    tuple[Array, Array]
        τ and v of the slowest preimage of each state.
    """
    out_tau, out_v = tau.copy(), v.copy()
    for i in range(tau.size):
        t, w = tau[i], v[i]
        for _ in range(steps[i]):
            status, t, w, _, _ = apply_inverse_impact_map(t, w, delta[i], epsilon[i], beta[i])
            if status != OK or w > ceiling[i]:
                break
            if w < out_v[i]:
                out_tau[i], out_v[i] = t, w
    return out_tau, out_v
