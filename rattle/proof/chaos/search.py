"""Search for horseshoes of the impact map Π in doubles; `prove` then proves or refuses them.

A horseshoe has a parallelogram to which chaotic motions return, the hub. A loop is a return to the hub: a chain of
parallelograms, each of which Π stretches across the next, from the hub back to the hub.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from rattle.errors import NotProvedError
from rattle.impacting.gear import Gear
from rattle.impacting.map.iterate import iterate, iterate_tangent
from rattle.numerics.complex_step import Array

#: Seed of the initial conditions.
SEED = 1
#: Number of random initial conditions. Each initial condition is followed for TRANSIENT impacts on Σ⁺; its motion is
#: then tested for chaos over TESTED_IMPACTS impacts.
INITIAL_CONDITIONS, TRANSIENT, TESTED_IMPACTS = 1500, 400, 200
#: Least Lyapunov exponent of a chaotic motion, per forcing period.
LEAST_EXPONENT = 0.02
#: At most MOST_MOTIONS chaotic motions are kept, each with IMPACTS_PER_MOTION impacts on Σ⁺. The state at the impact
#: with the index CENTRE_INDEX may be a hub's centre.
MOST_MOTIONS, IMPACTS_PER_MOTION, CENTRE_INDEX = 400, 72, 36
#: Number of states that are tried as centres of hubs.
CENTRES_TRIED = 24
#: Half sizes along the unstable direction of the parallelograms that are tried as hubs.
HUB_SIZES = (0.03, 0.02, 0.01, 0.005, 0.002, 0.001, 5e-4, 2e-4, 1e-4)
#: Ratios of the stable to the unstable half size of a hub that are tried.
HUB_RATIOS = (0.5, 1.0, 2.0, 4.0, 8.0)
#: Most impacts on Σ⁺ in a loop.
MOST_STEPS = 16
#: Loops are sought for at most MOST_HUBS hubs. They consist of returns to the hub. The returns of a hub have at most
#: MOST_WORDS different words (sequences of numbers of impacts on Σ⁻), and at most RETURNS_PER_WORD have the same word.
MOST_HUBS, RETURNS_PER_WORD, MOST_WORDS = 100, 3, 40
#: Hubs are used in rounds. In each round every centre has at most this many hubs, so that no centre uses up MOST_HUBS.
HUBS_PER_CENTRE = 2
#: Both ends of an image must reach beyond |ξ| = MARGIN_FACTOR in the next set. The height of the next set is
#: MARGIN_FACTOR times that of the image.
MARGIN_FACTOR = 1.2
#: Largest |η|, in the coordinates of the hub, of an image that crosses the hub.
LARGEST_ETA = 0.95
#: A hub is tried if the factors by which Π stretches its parts have ratios below LARGEST_STRETCH_RATIO, and if the
#: directions of the images of its parts make angles with their mean whose cosines are above LEAST_COSINE.
LARGEST_STRETCH_RATIO, LEAST_COSINE = 6.0, 0.9
#: Number of Newton steps in the search of a state that Π maps to a given ξ of the next set.
NEWTON_STEPS = 3
#: Number of rounds in which loops are chosen. Each round weighs loops by the entropy of the best choice so far.
SELECTION_ROUNDS = 4
#: Step of finite differences.
DIFFERENCE_STEP = 1e-7
#: Half lengths of a set that are tried, as ratios to the half length that the linearised map suggests.
LENGTH_FACTORS = 1.08 ** np.arange(-12, 40)


class StateParallelogram(NamedTuple):
    """A parallelogram of states, centre + sides @ (ξ, η) with |ξ|, |η| ≤ 1.

    centre (2,): time and speed. sides (2, 2): half sides along the unstable and the stable direction, as columns.
    """

    centre: Array
    sides: Array


class LoopCandidate(NamedTuple):
    """A loop that may be proved: a chain of sets from the hub back to the hub.

    boxes: the sets between two visits to the hub. words: for each step the number of impacts on Σ⁻.
    strip: the ends in ξ of the part of the hub that Π maps across the next set of the loop, on the line η = 0.
    """

    boxes: tuple[StateParallelogram, ...]
    words: tuple[int, ...]
    strip: tuple[float, float]


class HorseshoeCandidate(NamedTuple):
    """A candidate for a horseshoe: the hub, a parallelogram of states, and loops that start and end at the hub."""

    hub: StateParallelogram
    loops: tuple[LoopCandidate, ...]


class OrbitSegment(NamedTuple):
    """A motion from the hub (a parallelogram of states) back to the hub.

    states: the states (L + 1, 2) at its L + 1 impacts on Σ⁺. words: the numbers (L,) of impacts on Σ⁻ between
    successive impacts on Σ⁺.
    """

    states: Array
    words: tuple[int, ...]


@dataclass(frozen=True)
class ReturnMap:
    """The impact map Π at one point of the plane."""

    gear: Gear

    def __call__(self, x: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return the states (…, 2) at the next impact on Σ⁺, and the numbers of impacts on Σ⁻ before it.

        x: the times and speeds (…, 2) of departures from Σ⁺. The number is −1 where the motion sticks to a wall, or
        where the speed of the departure is not positive.

        Returns
        -------
        tuple[Array, NDArray[np.int64]]
            States, and numbers of impacts on Σ⁻.
        """
        gear, bad = self.gear, ~(x[..., 1] > 0)
        v = np.where(bad, 1.0, x[..., 1])
        out = iterate(gear.delta, gear.epsilon, x[..., 0] % 1.0, v, 1, gear.beta)
        return np.stack([out.tau, out.v], -1), np.where(bad | (out.n_plus < 1), -1, out.n_minus)

    def tangent(self, x: Array) -> Array:
        """Return the derivatives of Π at states (…, 2) as matrices (…, 2, 2), by finite differences."""
        moves = DIFFERENCE_STEP * np.eye(2).reshape(2, *(1,) * (x.ndim - 1), 2)
        return np.moveaxis(state_difference(self(x + moves)[0], self(x - moves)[0]) / (2 * DIFFERENCE_STEP), 0, -1)


def state_difference(x: Array, centre: Array) -> Array:
    """Return x − centre (…, 2), with differences of times shifted to [−½, ½)."""
    d = x - centre
    d[..., 0] = (d[..., 0] + 0.5) % 1.0 - 0.5
    return d


def entropy_of_loop_lengths(lengths: Sequence[float]) -> float:
    """Return the entropy h of a horseshoe: Σ e^(−h length) = 1, summed over its loops; 0 for fewer than two loops.

    lengths: for each loop its number of impacts on Σ⁺, or for each loop its number of forcing periods.

    Returns
    -------
    float
        h, in nats per impact on Σ⁺, or per forcing period.
    """
    if len(lengths) < 2:
        return 0.0
    times = np.asarray(lengths, float)
    return float(brentq(lambda h: float(np.exp(-h * times).sum()) - 1.0, 0.0, np.log(len(times)) + 1.0))


def search_horseshoes(gear: Gear) -> Iterator[HorseshoeCandidate]:
    """Yield candidates for horseshoes, the largest entropy first. Raises NotProvedError if no motion seems chaotic."""
    states, words = _find_chaotic_motions(gear)
    pi = ReturnMap(gear)
    tangents = pi.tangent(states[:-1])
    guesses: list[tuple[int, float, StateParallelogram, list[OrbitSegment]]] = []
    for place, unstable, stable in _hub_centres(gear, pi, states, tangents):
        here = list[tuple[float, StateParallelogram, list[OrbitSegment]]]()
        for size in HUB_SIZES:
            for shape in HUB_RATIOS:
                hub = StateParallelogram(place, np.column_stack([unstable * size, stable * size * shape]))
                if _is_stretched_evenly(pi, hub):
                    segments = list(_find_hub_returns(hub, states, words))
                    here.append(
                        (entropy_of_loop_lengths([len(word) for word in {x.words for x in segments}]), hub, segments)
                    )
        here.sort(key=lambda x: -x[0])
        guesses += [(rank // HUBS_PER_CENTRE, -h, hub, segments) for rank, (h, hub, segments) in enumerate(here)]
    guesses.sort(key=lambda x: x[:2])
    found = [
        HorseshoeCandidate(hub, tuple(_choose_loops(pi, hub, segments))) for *_, hub, segments in guesses[:MOST_HUBS]
    ]
    yield from sorted(found, key=lambda x: -_entropy_of_loops(x.loops))


def _find_chaotic_motions(gear: Gear) -> tuple[Array, NDArray[np.int64]]:
    """Return k motions of n impacts that seem chaotic: states (n + 1, k, 2), and numbers of impacts on Σ⁻ (n, k)."""
    rng = np.random.default_rng(SEED)
    speed = np.sqrt(16 * np.pi * gear.delta * gear.beta) + 2 * np.pi * gear.epsilon
    states = [np.column_stack([rng.uniform(0, 1, INITIAL_CONDITIONS), rng.uniform(0, 1.6 * speed, INITIAL_CONDITIONS)])]
    for orbit in gear.orbits():
        near = 10.0 ** rng.uniform(-5, -2, INITIAL_CONDITIONS // 4)[:, None] * rng.uniform(
            -1, 1, (INITIAL_CONDITIONS // 4, 2)
        )
        states.append(np.array([orbit.tau, orbit.v]) + near)
    x = np.concatenate(states)
    point = gear.delta, gear.epsilon
    settled = iterate(*point, x[:, 0] % 1.0, np.abs(x[:, 1]) + 1e-9, TRANSIENT, gear.beta)
    alive = settled.n_plus == TRANSIENT
    x = np.column_stack([settled.tau, settled.v])[alive]
    if len(x):
        seen = iterate_tangent(*point, x[:, 0], x[:, 1], TESTED_IMPACTS, gear.beta)
        x = x[(seen.n_plus == TESTED_IMPACTS) & (seen.time > TESTED_IMPACTS / 4) & (seen.lyapunov[0] > LEAST_EXPONENT)]
    if not len(x):
        raise NotProvedError(
            "no motion that seems chaotic was found at this point: choose a point where a survey shows chaos"
        )
    path, words = [x[:MOST_MOTIONS]], []
    for _ in range(IMPACTS_PER_MOTION):
        after, word = ReturnMap(gear)(path[-1])
        path.append(after)
        words.append(word)
    return np.array(path), np.array(words)


def _hub_centres(gear: Gear, pi: ReturnMap, states: Array, tangents: Array) -> Iterator[tuple[Array, Array, Array]]:
    """Yield centres of hubs, each with unit vectors along its unstable and its stable direction.

    states (n + 1, k, 2): k chaotic motions of n impacts. tangents (n, k, 2, 2): the derivatives of Π at all states but
    the last of each motion.

    Yields
    ------
    tuple[Array, Array, Array]
        Centre, unstable direction, stable direction. The first centres are the period-one saddles; then some of the
        `states` follow.
    """
    for orbit in gear.orbits():
        x = np.array([orbit.tau, orbit.v])
        values, vectors = np.linalg.eig(pi.tangent(x))
        if np.isreal(values).all() and np.min(np.abs(values)) < 1 < np.max(np.abs(values)):
            order = np.argsort(-np.abs(values))
            yield x, np.real(vectors[:, order[0]]), np.real(vectors[:, order[1]])
    for j in np.linspace(0, states.shape[1] - 1, CENTRES_TRIED).astype(int):
        unstable, stable = np.array([1.0, 0.3]), np.array([0.3, 1.0])
        for i in range(CENTRE_INDEX):
            unstable = _unit_vector(tangents[i, j] @ unstable)
        for i in range(len(tangents) - 1, CENTRE_INDEX - 1, -1):
            stable = _unit_preimage(tangents[i, j], stable)
        if abs(np.linalg.det(np.column_stack([unstable, stable]))) > 1e-3:
            yield states[CENTRE_INDEX, j], unstable, stable


def _unit_vector(x: Array) -> Array:
    return np.asarray(x / np.linalg.norm(x))


def _unit_preimage(tangent: Array, x: Array) -> Array:
    """Return the preimage of x under a tangent map, scaled to length 1."""
    (a, b), (c, d) = tangent
    return _unit_vector(np.array([d * x[0] - b * x[1], a * x[1] - c * x[0]]))


def _grid_of_box(box: StateParallelogram, n_xi: int, n_eta: int) -> Array:
    """Return a grid of states (n_xi, n_eta, 2) in a box: n_xi × n_eta points, equally spaced along ξ and along η."""
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, n_xi), np.linspace(-1, 1, n_eta), indexing="ij"), -1)
    return np.asarray(box.centre + grid @ box.sides.T)


def _is_stretched_evenly(pi: ReturnMap, hub: StateParallelogram) -> bool:
    """Return whether Π stretches the hub almost uniformly and maps it to an almost straight image."""
    after, words = pi(_grid_of_box(hub, 9, 5))
    if np.ptp(words) > 0 or words[0, 0] < 0:
        return False
    moves = state_difference(after[1:], after[:-1])
    lengths = np.linalg.norm(moves, axis=-1)
    mean = _unit_vector(moves.mean((0, 1)))
    return bool(
        lengths.min() > 0
        and lengths.max() < LARGEST_STRETCH_RATIO * lengths.min()
        and (moves @ mean > LEAST_COSINE * lengths).all()
    )


def _find_hub_returns(hub: StateParallelogram, states: Array, words: NDArray[np.int64]) -> Iterator[OrbitSegment]:
    """Yield motions from the hub back to the hub, the shortest first.

    Yields
    ------
    OrbitSegment
        A motion; at most RETURNS_PER_WORD of the motions have the same word (numbers of impacts on Σ⁻).
    """
    inside = np.all(np.abs(state_difference(states, hub.centre) @ np.linalg.inv(hub.sides).T) < 1, axis=-1)
    found: list[tuple[int, int, int]] = []
    for column in np.flatnonzero(inside.sum(0) > 1):
        visits = np.flatnonzero(inside[:, column])
        found += [(int(b - a), int(a), int(column)) for a, b in pairwise(visits)]
    seen: dict[tuple[int, ...], int] = {}
    for length, start, j in sorted(found):
        word = tuple(int(x) for x in words[start : start + length, j])
        seen[word] = seen.get(word, 0) + 1
        if seen[word] <= RETURNS_PER_WORD and length <= MOST_STEPS and min(word) >= 0 and len(seen) <= MOST_WORDS:
            yield OrbitSegment(states[start : start + length + 1, j], word)


def _choose_loops(pi: ReturnMap, hub: StateParallelogram, segments: Sequence[OrbitSegment]) -> list[LoopCandidate]:
    """Return loops along some of the motions `segments`, chosen to have disjoint strips of the hub and a large entropy.

    Returns
    -------
    list[LoopCandidate]
        The loops, the shortest first.
    """
    found = [loop for segment in segments if (loop := _find_loop_along(pi, hub, segment)) is not None]
    found.sort(key=lambda loop: loop.strip[1])
    # each round chooses disjoint strips with the largest Σ e^(−rate · length); the next rate is the best entropy so far
    rate, best = 0.3, list[LoopCandidate]()
    for _ in range(SELECTION_ROUNDS):
        chosen: list[tuple[float, list[LoopCandidate]]] = [(0.0, [])]
        for i, loop in enumerate(found):
            apart = sum(other.strip[1] < loop.strip[0] for other in found[:i])
            weight, others = chosen[apart]
            weight += float(np.exp(-rate * len(loop.words)))
            chosen.append((weight, [*others, loop]) if weight > chosen[i][0] else chosen[i])
        best = max(best, chosen[-1][1], key=_entropy_of_loops)
        rate = max(_entropy_of_loops(best), 0.05)
    return sorted(best, key=lambda loop: len(loop.words))


def _entropy_of_loops(loops: Sequence[LoopCandidate]) -> float:
    return entropy_of_loop_lengths([len(loop.words) for loop in loops])


def _find_loop_along(pi: ReturnMap, hub: StateParallelogram, segment: OrbitSegment) -> LoopCandidate | None:
    """Return the loop along a motion from the hub to the hub; None if Π does not stretch each set across the next."""
    x, words, steps = segment.states, segment.words, len(segment.words)
    if steps == 1:
        high, strip = _measure_crossing_image(pi, hub, hub, words[0])
        return LoopCandidate((), words, strip) if high < LARGEST_ETA else None
    tangents = pi.tangent(x[:-1])
    unstable, stable = [_unit_vector(hub.sides[:, 0])], [_unit_vector(hub.sides[:, 1])]
    for tangent in tangents:
        unstable.append(_unit_vector(tangent @ unstable[-1]))
        stable.append(_unit_preimage(tangents[steps - len(stable)], stable[-1]))
    stable.reverse()
    lengths = np.zeros(steps)
    target = hub
    # from the last set to the first: the half length along ξ is chosen such that the image reaches beyond the next set
    for i in range(steps - 1, -1, -1):
        reached = _least_half_length(pi, x[i], unstable[i], tangents[i] @ unstable[i], target, words[i])
        if reached is None:
            return None
        lengths[i] = reached
        target = StateParallelogram(x[i], np.column_stack([unstable[i] * reached, stable[i]]))
    boxes: list[StateParallelogram] = []
    source, strip = hub, (0.0, 0.0)
    # the half height along η of each set is chosen such that the set contains the image of the preceding set
    for i in range(1, steps):
        flat = StateParallelogram(x[i], np.column_stack([unstable[i] * lengths[i], stable[i]]))
        high, where = _measure_crossing_image(pi, source, flat, words[i - 1])
        if not high < np.inf:
            return None
        strip = where if i == 1 else strip
        source = StateParallelogram(x[i], np.column_stack([flat.sides[:, 0], flat.sides[:, 1] * high * MARGIN_FACTOR]))
        boxes.append(source)
    if not _measure_crossing_image(pi, source, hub, words[-1])[0] < LARGEST_ETA:
        return None
    return LoopCandidate(tuple(boxes), words, strip)


def _least_half_length(
    pi: ReturnMap, x: Array, unstable: Array, stretched: Array, target: StateParallelogram, word: int
) -> float | None:
    """Return the least half length of a segment through x along `unstable` whose image under Π crosses the target.

    stretched: the derivative of Π along `unstable`. word: the number of impacts on Σ⁻ that the motions must make.

    Returns
    -------
    float | None
        None if none of the half lengths that are tried suffices.
    """
    back = np.linalg.inv(target.sides)
    speed = abs(float((back @ stretched)[0]))
    if not speed > 0:
        return None
    sizes = MARGIN_FACTOR / speed * LENGTH_FACTORS
    ends, words = pi(x + np.array([[[-1.0]], [[1.0]]]) * sizes[:, None] * unstable)
    left, right = (state_difference(ends, target.centre) @ back.T)[..., 0]
    good = (words == word).all(0) & (left * right < 0) & (np.minimum(np.abs(left), np.abs(right)) > MARGIN_FACTOR)
    return float(sizes[np.argmax(good)]) if good.any() else None


def _measure_crossing_image(
    pi: ReturnMap, source: StateParallelogram, target: StateParallelogram, word: int
) -> tuple[float, tuple[float, float]]:
    """Return the height of the image of `source` where it crosses `target`, and the part of `source` that crosses.

    word: the number of impacts on Σ⁻ that the motions must make.

    Returns
    -------
    tuple[float, tuple[float, float]]
        The height: the largest |η| of the crossing part of the image, in the target's coordinates. It is infinite if Π
        does not stretch the source across the target, or if a motion does not make `word` impacts. The part: both ends
        in ξ of the crossing part of the source, on the line η = 0 of the source.
    """
    back, aims = np.linalg.inv(target.sides), np.linspace(-MARGIN_FACTOR, MARGIN_FACTOR, 25)
    coarse, eta = np.linspace(-1, 1, 41), np.linspace(-1, 1, 5)

    def image_coordinates(xi: Array) -> tuple[Array, bool]:
        """Return the images under Π of the source's states (xi, eta), and whether all make `word` impacts on Σ⁻.

        xi (…, 5): coordinates ξ of the source, for each of the five coordinates `eta`.

        Returns
        -------
        tuple[Array, bool]
            The images (…, 5, 2) in the coordinates of the target, and the flag.
        """
        after, words = pi(source.centre + np.stack([xi, np.broadcast_to(eta, xi.shape)], -1) @ source.sides.T)
        return state_difference(after, target.centre) @ back.T, bool((words == word).all())

    first = image_coordinates(np.repeat(coarse[:, None], eta.size, 1))[0][..., 0]
    rises = np.diff(first, axis=0)
    if not ((rises > 0).all(0) | (rises < 0).all(0)).all():
        return np.inf, (0.0, 0.0)
    xi = np.empty((aims.size, eta.size))
    for k in range(eta.size):
        order = np.argsort(first[:, k])
        xi[:, k] = np.interp(aims, first[order, k], coarse[order])
    for _ in range(NEWTON_STEPS):
        step = np.where(xi > 0, -DIFFERENCE_STEP, DIFFERENCE_STEP)
        lacks = image_coordinates(xi)[0][..., 0]
        slope = (image_coordinates(xi + step)[0][..., 0] - lacks) / step
        if not np.abs(slope).min() > 0:
            return np.inf, (0.0, 0.0)
        xi = np.clip(xi - (lacks - aims[:, None]) / slope, -1.0, 1.0)
    found, same = image_coordinates(xi)
    reached = np.abs(found[..., 0] - aims[:, None]).max() < 0.1
    if not (same and reached):
        return np.inf, (0.0, 0.0)
    middle = eta.size // 2
    return float(np.abs(found[..., 1]).max()), (float(xi[:, middle].min()), float(xi[:, middle].max()))
