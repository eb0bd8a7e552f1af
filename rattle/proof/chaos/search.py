"""Search for horseshoes in doubles. `prove` then proves or refuses them.

The search looks for a parallelogram, the hub, to which chaotic motions return. Along each return it constructs
parallelograms through which Π stretches the hub back across itself.
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

SEED = 1  # seed of the random initial conditions
STATES, SETTLING, WATCHED = 1500, 400, 200  # motions, impacts of their transient, impacts that measure their exponent
CHAOTIC = 0.02  # least Lyapunov exponent of a chaotic motion, per forcing period
KEPT, STEPS, MIDDLE = 400, 72, 36  # chaotic motions, their impacts, and the impact whose states are candidate hubs
PLACES = 24
SIZES = (0.03, 0.02, 0.01, 0.005, 0.002, 0.001, 5e-4, 2e-4, 1e-4)  # half-sides of hubs along the unstable direction
SHAPES = (0.5, 1.0, 2.0, 4.0, 8.0)  # ratios of the side along the stable direction to that along the unstable one
MOST_STEPS = 16  # longest loop, in impacts on Σ⁺
TRIED, EACH, MOST_WORDS = 100, 3, 40  # hubs whose loops are computed; returns for each itinerary; itineraries
TOGETHER = 2  # hubs at one state that are tried before those at the next state
ROOM = 1.2  # factor by which a set overlaps the next one, along ξ and along η
HIGHEST = 0.95
UNEVEN, FLAT = 6.0, 0.9  # largest ratio of stretch rates in a hub; least cosine between directions in its image
CORRECTED = 3  # Newton steps for the points that map to the edges of a set
SCHEDULED = 4  # times that loops are chosen; each choice uses the growth rate h of the previous one
NEAR = 1e-7  # step of finite differences
GROWTH = 1.08 ** np.arange(-12, 40)


class StateBox(NamedTuple):
    """The parallelogram centre + ξ unstable + η stable, |ξ|, |η| ≤ 1, with centre (2,) and sides (2, 2) as columns."""

    centre: Array
    sides: Array


class FoundLoop(NamedTuple):
    """The boxes between two visits to the hub, and the number of Σ⁻ impacts in each step."""

    boxes: tuple[StateBox, ...]
    words: tuple[int, ...]
    strip: tuple[float, float]  # the range of ξ in the hub from which the loop starts


class Found(NamedTuple):
    """A hub and its loops."""

    hub: StateBox
    loops: tuple[FoundLoop, ...]


class OrbitSegment(NamedTuple):
    """A motion from the hub back to it: states (L + 1, 2), and Σ⁻ impacts (L,) in each step."""

    states: Array
    words: tuple[int, ...]


@dataclass(frozen=True)
class ReturnMap:
    """The impact map Π at one point of the plane."""

    gear: Gear

    def __call__(self, x: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return states (…, 2) at the next impact on Σ⁺, and the Σ⁻ impacts before it (−1 where none follows)."""
        gear, bad = self.gear, ~(x[..., 1] > 0)
        v = np.where(bad, 1.0, x[..., 1])
        out = iterate(gear.delta, gear.epsilon, x[..., 0] % 1.0, v, 1, gear.beta)
        return np.stack([out.tau, out.v], -1), np.where(bad | (out.n_plus < 1), -1, out.n_minus)

    def tangent(self, x: Array) -> Array:
        """Return DΠ (…, 2, 2) by central differences."""
        moves = NEAR * np.eye(2).reshape(2, *(1,) * (x.ndim - 1), 2)
        return np.moveaxis(away(self(x + moves)[0], self(x - moves)[0]) / (2 * NEAR), 0, -1)


def away(x: Array, centre: Array) -> Array:
    """Return x − centre (…, 2), with the time difference reduced to [−½, ½)."""
    d = x - centre
    d[..., 0] = (d[..., 0] + 0.5) % 1.0 - 0.5
    return d


def growth(lengths: Sequence[float]) -> float:
    """Return the h for which Σ e^(−h length) = 1. It is 0 for fewer than two loops."""
    if len(lengths) < 2:
        return 0.0
    times = np.asarray(lengths, float)
    return float(brentq(lambda h: float(np.exp(-h * times).sum()) - 1.0, 0.0, np.log(len(times)) + 1.0))


def search_horseshoes(gear: Gear) -> Iterator[Found]:
    """Yield candidate horseshoes, the largest entropy first. Raises NotProvedError if no motion seems chaotic."""
    states, words = _chaotic(gear)
    pi = ReturnMap(gear)
    tangents = pi.tangent(states[:-1])
    guesses: list[tuple[int, float, StateBox, list[OrbitSegment]]] = []
    for place, unstable, stable in _places(gear, pi, states, tangents):
        here = list[tuple[float, StateBox, list[OrbitSegment]]]()
        for size in SIZES:
            for shape in SHAPES:
                hub = StateBox(place, np.column_stack([unstable * size, stable * size * shape]))
                if _is_flat(pi, hub):
                    segments = list(_returns(hub, states, words))
                    here.append((growth([len(word) for word in {x.words for x in segments}]), hub, segments))
        here.sort(key=lambda x: -x[0])
        guesses += [(rank // TOGETHER, -h, hub, segments) for rank, (h, hub, segments) in enumerate(here)]
    guesses.sort(key=lambda x: x[:2])
    found = [Found(hub, tuple(_loops(pi, hub, segments))) for *_, hub, segments in guesses[:TRIED]]
    yield from sorted(found, key=lambda x: -_growth_of(x.loops))


def _chaotic(gear: Gear) -> tuple[Array, NDArray[np.int64]]:
    """Return chaotic motions as states (STEPS + 1, k, 2) and Σ⁻ impacts (STEPS, k)."""
    rng = np.random.default_rng(SEED)
    speed = np.sqrt(16 * np.pi * gear.delta * gear.beta) + 2 * np.pi * gear.epsilon
    states = [np.column_stack([rng.uniform(0, 1, STATES), rng.uniform(0, 1.6 * speed, STATES)])]
    for orbit in gear.orbits():
        near = 10.0 ** rng.uniform(-5, -2, STATES // 4)[:, None] * rng.uniform(-1, 1, (STATES // 4, 2))
        states.append(np.array([orbit.tau, orbit.v]) + near)
    x = np.concatenate(states)
    point = gear.delta, gear.epsilon
    settled = iterate(*point, x[:, 0] % 1.0, np.abs(x[:, 1]) + 1e-9, SETTLING, gear.beta)
    alive = settled.n_plus == SETTLING
    x = np.column_stack([settled.tau, settled.v])[alive]
    if len(x):
        seen = iterate_tangent(*point, x[:, 0], x[:, 1], WATCHED, gear.beta)
        x = x[(seen.n_plus == WATCHED) & (seen.time > WATCHED / 4) & (seen.lyapunov[0] > CHAOTIC)]
    if not len(x):
        raise NotProvedError(f"no chaotic motion was found at delta = {gear.delta!r}, epsilon = {gear.epsilon!r}")
    path, words = [x[:KEPT]], []
    for _ in range(STEPS):
        after, word = ReturnMap(gear)(path[-1])
        path.append(after)
        words.append(word)
    return np.array(path), np.array(words)


def _places(gear: Gear, pi: ReturnMap, states: Array, tangents: Array) -> Iterator[tuple[Array, Array, Array]]:
    """Yield candidate centres of hubs, with unit vectors near their unstable and stable directions."""
    for orbit in gear.orbits():
        x = np.array([orbit.tau, orbit.v])
        values, vectors = np.linalg.eig(pi.tangent(x))
        if np.isreal(values).all() and np.min(np.abs(values)) < 1 < np.max(np.abs(values)):
            order = np.argsort(-np.abs(values))
            yield x, np.real(vectors[:, order[0]]), np.real(vectors[:, order[1]])
    for j in np.linspace(0, states.shape[1] - 1, PLACES).astype(int):
        unstable, stable = np.array([1.0, 0.3]), np.array([0.3, 1.0])
        for i in range(MIDDLE):
            unstable = _unit(tangents[i, j] @ unstable)
        for i in range(len(tangents) - 1, MIDDLE - 1, -1):
            stable = _pulled(tangents[i, j], stable)
        if abs(np.linalg.det(np.column_stack([unstable, stable]))) > 1e-3:
            yield states[MIDDLE, j], unstable, stable


def _unit(x: Array) -> Array:
    return np.asarray(x / np.linalg.norm(x))


def _pulled(tangent: Array, x: Array) -> Array:
    """Return the preimage of a direction under a tangent map, scaled to length 1."""
    (a, b), (c, d) = tangent
    return _unit(np.array([d * x[0] - b * x[1], a * x[1] - c * x[0]]))


def _samples(box: StateBox, across: int, high: int) -> Array:
    """Return a grid of states (across, high, 2) in a box."""
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, across), np.linspace(-1, 1, high), indexing="ij"), -1)
    return np.asarray(box.centre + grid @ box.sides.T)


def _is_flat(pi: ReturnMap, hub: StateBox) -> bool:
    """Return whether Π stretches the box nearly uniformly, so that its image hardly bends."""
    after, words = pi(_samples(hub, 9, 5))
    if np.ptp(words) > 0 or words[0, 0] < 0:
        return False
    moves = away(after[1:], after[:-1])
    lengths = np.linalg.norm(moves, axis=-1)
    mean = _unit(moves.mean((0, 1)))
    return bool(lengths.min() > 0 and lengths.max() < UNEVEN * lengths.min() and (moves @ mean > FLAT * lengths).all())


def _returns(hub: StateBox, states: Array, words: NDArray[np.int64]) -> Iterator[OrbitSegment]:
    """Yield first returns to the hub, the shortest first, and at most EACH with the same itinerary."""
    inside = np.all(np.abs(away(states, hub.centre) @ np.linalg.inv(hub.sides).T) < 1, axis=-1)
    found: list[tuple[int, int, int]] = []
    for column in np.flatnonzero(inside.sum(0) > 1):
        visits = np.flatnonzero(inside[:, column])
        found += [(int(b - a), int(a), int(column)) for a, b in pairwise(visits)]
    seen: dict[tuple[int, ...], int] = {}
    for length, start, j in sorted(found):
        word = tuple(int(x) for x in words[start : start + length, j])
        seen[word] = seen.get(word, 0) + 1
        if seen[word] <= EACH and length <= MOST_STEPS and min(word) >= 0 and len(seen) <= MOST_WORDS:
            yield OrbitSegment(states[start : start + length + 1, j], word)


def _loops(pi: ReturnMap, hub: StateBox, segments: Sequence[OrbitSegment]) -> list[FoundLoop]:
    """Return loops with disjoint strips in the hub, chosen for the largest growth rate."""
    found = [loop for segment in segments if (loop := _loop(pi, hub, segment)) is not None]
    found.sort(key=lambda loop: loop.strip[1])
    rate, best = 0.3, list[FoundLoop]()
    for _ in range(SCHEDULED):
        chosen: list[tuple[float, list[FoundLoop]]] = [(0.0, [])]
        for i, loop in enumerate(found):
            apart = sum(other.strip[1] < loop.strip[0] for other in found[:i])
            weight, others = chosen[apart]
            weight += float(np.exp(-rate * len(loop.words)))
            chosen.append((weight, [*others, loop]) if weight > chosen[i][0] else chosen[i])
        best = max(best, chosen[-1][1], key=_growth_of)
        rate = max(_growth_of(best), 0.05)
    return sorted(best, key=lambda loop: len(loop.words))


def _growth_of(loops: Sequence[FoundLoop]) -> float:
    return growth([len(loop.words) for loop in loops])


def _loop(pi: ReturnMap, hub: StateBox, segment: OrbitSegment) -> FoundLoop | None:
    """Return the loop along a segment, or None if it does not stretch the hub across itself."""
    x, words, steps = segment.states, segment.words, len(segment.words)
    if steps == 1:
        high, strip = _across(pi, hub, hub, words[0])
        return FoundLoop((), words, strip) if high < HIGHEST else None
    tangents = pi.tangent(x[:-1])
    unstable, stable = [_unit(hub.sides[:, 0])], [_unit(hub.sides[:, 1])]
    for tangent in tangents:
        unstable.append(_unit(tangent @ unstable[-1]))
        stable.append(_pulled(tangents[steps - len(stable)], stable[-1]))
    stable.reverse()
    lengths = np.zeros(steps)
    target = hub
    for i in range(steps - 1, -1, -1):  # make each box long enough for its image to overlap the next box
        reached = _reach(pi, x[i], unstable[i], tangents[i] @ unstable[i], target, words[i])
        if reached is None:
            return None
        lengths[i] = reached
        target = StateBox(x[i], np.column_stack([unstable[i] * reached, stable[i]]))
    boxes: list[StateBox] = []
    source, strip = hub, (0.0, 0.0)
    for i in range(1, steps):  # make each box high enough to hold the image of the previous one
        flat = StateBox(x[i], np.column_stack([unstable[i] * lengths[i], stable[i]]))
        high, where = _across(pi, source, flat, words[i - 1])
        if not high < np.inf:
            return None
        strip = where if i == 1 else strip
        source = StateBox(x[i], np.column_stack([flat.sides[:, 0], flat.sides[:, 1] * high * ROOM]))
        boxes.append(source)
    if not _across(pi, source, hub, words[-1])[0] < HIGHEST:
        return None
    return FoundLoop(tuple(boxes), words, strip)


def _reach(pi: ReturnMap, x: Array, unstable: Array, stretched: Array, target: StateBox, word: int) -> float | None:
    """Return the half-length of a box at x whose two edges map beyond opposite edges of the target, or None."""
    back = np.linalg.inv(target.sides)
    speed = abs(float((back @ stretched)[0]))
    if not speed > 0:
        return None
    sizes = ROOM / speed * GROWTH
    ends, words = pi(x + np.array([[[-1.0]], [[1.0]]]) * sizes[:, None] * unstable)
    left, right = (away(ends, target.centre) @ back.T)[..., 0]
    good = (words == word).all(0) & (left * right < 0) & (np.minimum(np.abs(left), np.abs(right)) > ROOM)
    return float(sizes[np.argmax(good)]) if good.any() else None


def _across(pi: ReturnMap, source: StateBox, target: StateBox, word: int) -> tuple[float, tuple[float, float]]:
    """Return the largest |η| of the image of a box between the target's edges, and the range of ξ that maps there.

    The range is taken at η = 0, and includes a margin beyond the edges.

    Returns
    -------
    tuple[float, tuple[float, float]]
        The largest |η|, infinite if Π does not stretch the box across the target or meets other walls; both ends of ξ.
    """
    back, aims = np.linalg.inv(target.sides), np.linspace(-ROOM, ROOM, 25)
    coarse, eta = np.linspace(-1, 1, 41), np.linspace(-1, 1, 5)

    def seen(xi: Array) -> tuple[Array, bool]:
        after, words = pi(source.centre + np.stack([xi, np.broadcast_to(eta, xi.shape)], -1) @ source.sides.T)
        return away(after, target.centre) @ back.T, bool((words == word).all())

    first = seen(np.repeat(coarse[:, None], eta.size, 1))[0][..., 0]
    rises = np.diff(first, axis=0)
    if not ((rises > 0).all(0) | (rises < 0).all(0)).all():
        return np.inf, (0.0, 0.0)
    xi = np.empty((aims.size, eta.size))
    for k in range(eta.size):
        order = np.argsort(first[:, k])
        xi[:, k] = np.interp(aims, first[order, k], coarse[order])
    for _ in range(CORRECTED):
        step = np.where(xi > 0, -NEAR, NEAR)
        lacks = seen(xi)[0][..., 0]
        slope = (seen(xi + step)[0][..., 0] - lacks) / step
        if not np.abs(slope).min() > 0:
            return np.inf, (0.0, 0.0)
        xi = np.clip(xi - (lacks - aims[:, None]) / slope, -1.0, 1.0)
    found, same = seen(xi)
    reached = np.abs(found[..., 0] - aims[:, None]).max() < 0.1
    if not (same and reached):
        return np.inf, (0.0, 0.0)
    middle = eta.size // 2
    return float(np.abs(found[..., 1]).max()), (float(xi[:, middle].min()), float(xi[:, middle].max()))
