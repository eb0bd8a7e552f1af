"""The attractors at one parameter point, with the share of initial conditions that each one wins."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rattle import classify as fate
from rattle.errors import require_integer, require_number
from rattle.lyapunov import pooled
from rattle.quiet import capture_invariant
from rattle.sampling import initial_conditions, wilson_interval

KINDS = ("none", "quiet", "periodic", "chaotic", "undecided")
SAME_POINT = 1e-6  # two periodic orbits of one label closer than this are one
SAME_FOOTPRINT = 0.2  # two chaotic trajectories that share this much of the smaller footprint are on one attractor
MOST_SAMPLES = 1 << 20
LARGEST_SEED = (1 << 128) - 1
LATE = 400  # impacts after which only chaos or a slow approach has not settled
LONGER_WATCHES = 2  # each four times as long as the one before


@dataclass(frozen=True)
class Attractor:
    """A motion that attracts a share of the sampled initial conditions.

    kind is quiet, periodic, chaotic or undecided (all undecided samples together). m, n_plus, n_minus: the label P(m,
    n₊, n₋), 0 unless periodic. fraction of the sample, with its 95 % Wilson interval. lyapunov: both exponents per
    forcing period, natural logarithm (periodic: ln|multiplier|/m; NaN for quiet and undecided). lyapunov_error: 95 %
    half-width of the first (0 for periodic). tau, v: a point of it on Σ⁺ (periodic: its fastest impact).
    """

    kind: str
    m: int
    n_plus: int
    n_minus: int
    fraction: float
    fraction_interval: tuple[float, float]
    lyapunov: tuple[float, float]
    lyapunov_error: float
    tau: float
    v: float


@dataclass
class _Group:
    """Samples that go to one attractor, and the boxes that they visited if it is chaotic."""

    outcome: fate.Outcome
    footprint: NDArray[np.uint64]
    members: list[int] = field(default_factory=list)


def _bits(footprint: NDArray[np.uint64]) -> int:
    return int(np.bitwise_count(footprint).sum())


def _same_periodic(a: fate.Outcome, b: fate.Outcome, point: fate.Point) -> bool:
    """Whether b's point is one of a's. Both are the fastest impact, but a near tie may be broken either way."""
    if (a.m, a.n_plus, a.n_minus) != (b.m, b.n_plus, b.n_minus) or abs(a.v - b.v) > SAME_POINT:
        return False
    tau, v = a.tau, a.v
    for _ in range(a.n_plus):
        if abs(fate.wrapped(tau - b.tau)) < SAME_POINT and abs(v - b.v) < SAME_POINT:
            return True
        _, tau, v, _, _ = fate.impact(tau, v, point.delta, point.epsilon, point.beta, fate.DRIFT)
    return False


def _overlap(a: NDArray[np.uint64], b: NDArray[np.uint64]) -> bool:
    """Whether two chaotic trajectories visited the same boxes; different attractors are disjoint sets."""
    return _bits(a & b) > SAME_FOOTPRINT * min(_bits(a), _bits(b))


def _find(
    groups: list[_Group], outcome: fate.Outcome, footprint: NDArray[np.uint64], point: fate.Point
) -> _Group | None:
    for group in groups:
        if group.outcome.kind != outcome.kind:
            continue
        if outcome.kind in (fate.QUIET, fate.UNDECIDED):
            return group
        if outcome.kind == fate.PERIODIC:
            if _same_periodic(group.outcome, outcome, point):
                return group
        elif _overlap(group.footprint, footprint):
            return group
    return None


def _merge(outcomes: list[fate.Outcome], footprints: NDArray[np.uint64], point: fate.Point) -> list[_Group]:
    """Group the samples by attractor, in the order of the sample."""
    groups: list[_Group] = []
    for i, outcome in enumerate(outcomes):
        group = _find(groups, outcome, footprints[i], point)
        if group is None:
            group = _Group(outcome, np.zeros_like(footprints[i]))
            groups.append(group)
        if outcome.kind == fate.CHAOTIC:
            group.footprint |= footprints[i]
        group.members.append(i)
    return _join(groups)


def _join(groups: list[_Group]) -> list[_Group]:
    """Join chaotic groups whose footprints have grown together, until none are left to join."""
    joined: list[_Group] = []
    for group in groups:
        for other in [each for each in joined if _overlap(each.footprint, group.footprint)]:
            joined.remove(other)
            other.members = sorted(other.members + group.members)
            other.footprint |= group.footprint
            group = other
        joined.append(group)
    return joined if len(joined) == len(groups) else _join(joined)


def _attractor(group: _Group, sums: NDArray[np.float64], count: int) -> Attractor:
    o = group.outcome
    lyapunov, error = (np.nan, np.nan), np.nan
    if o.kind == fate.PERIODIC:
        lyapunov, error = (float(o.log_first), float(o.log_second)), 0.0
    elif o.kind == fate.CHAOTIC:
        first, second, error = pooled(sums[group.members])
        lyapunov = (first, second)
    low, high = wilson_interval(len(group.members), count)
    return Attractor(
        kind=KINDS[o.kind],
        m=int(o.m),
        n_plus=int(o.n_plus),
        n_minus=int(o.n_minus),
        fraction=len(group.members) / count,
        fraction_interval=(float(low), float(high)),
        lyapunov=lyapunov,
        lyapunov_error=error,
        tau=float(o.tau),
        v=float(o.v),
    )


def _budget(delta: float) -> fate.Budget:
    """The default, with a transient of fifty relaxation times 1/δ where that is longer, within reason."""
    default = fate.Budget()
    return default._replace(transient=min(max(default.transient, 50 / delta), 20 * default.transient))


def _classify(
    tau: NDArray[np.float64], v: NDArray[np.float64], point: fate.Point, budget: fate.Budget
) -> tuple[list[fate.Outcome], NDArray[np.float64], NDArray[np.uint64]]:
    """Outcomes, batch sums and footprints of a sample, where a chaotic set that leaks is watched for longer.

    If some samples settled only after hundreds of impacts, the others may be on the same chaotic transient.
    """
    outcomes, sums, footprints = fate.classify_many(tau, v, point, budget)
    for _ in range(LONGER_WATCHES):
        chaotic = [i for i, o in enumerate(outcomes) if o.kind == fate.CHAOTIC]
        late = any(o.kind in (fate.QUIET, fate.PERIODIC) and o.impacts > LATE for o in outcomes)
        if not (chaotic and late):
            break
        budget = budget._replace(transient=4 * budget.transient, impacts=4 * budget.impacts)
        states = np.array([(outcomes[i].tau, outcomes[i].v) for i in chaotic])
        again, sums[chaotic], footprints[chaotic] = fate.classify_many(
            np.ascontiguousarray(states[:, 0]), np.ascontiguousarray(states[:, 1]), point, budget
        )
        for i, outcome in zip(chaotic, again, strict=True):
            outcomes[i] = outcome._replace(impacts=outcomes[i].impacts + outcome.impacts)
    return outcomes, sums, footprints


def attractors(
    delta: float, epsilon: float, beta: float, count: int, v_max: float, seed: int, budget: fate.Budget | None = None
) -> tuple[Attractor, ...]:
    """See `rattle.Gear.attractors`."""
    count = require_integer("count", count, 1, MOST_SAMPLES)
    seed = require_integer("seed", seed, 0, LARGEST_SEED)
    v_max = require_number("v_max", v_max, positive=True)
    tau, v = initial_conditions(count, v_max, seed, (delta, epsilon, beta))
    point = fate.Point(delta, epsilon, beta, capture_invariant(delta, epsilon, beta))
    outcomes, sums, footprints = _classify(tau, v, point, budget or _budget(delta))
    groups = _merge(outcomes, footprints, point)
    found = (_attractor(group, sums, count) for group in groups)
    return tuple(sorted(found, key=lambda a: (-a.fraction, KINDS.index(a.kind), a.m, a.n_plus, a.n_minus, a.v, a.tau)))
