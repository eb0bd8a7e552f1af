"""Motion between the impacts of a periodic orbit, by Gauss-Legendre quadrature with nodes on every piece."""

from typing import NamedTuple

import numpy as np

import rattle
from rattle.intensity.motions import Motion
from rattle.models import AnyGear
from rattle.stiff import StiffGear

NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)
LONGEST = 0.05  # forcing periods of a piece


class Nodes(NamedTuple):
    """Times, weights, Φ and Φ' (n,) of the nodes of a quadrature over a period."""

    time: np.ndarray
    weight: np.ndarray
    phi: np.ndarray
    velocity: np.ndarray


def flown(gear: AnyGear, wall: int, start: float, w: float, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Φ and Φ' on a flight, by the paper's (3.1), (3.2)."""
    delta, epsilon, turn = gear.delta, gear.epsilon, 2 * np.pi
    a = 4 * np.pi - turn * epsilon * np.sin(turn * start) - w
    swing = np.cos(turn * (start + s)) - np.cos(turn * start)
    phi = wall * gear.beta + a / delta * np.expm1(-delta * s) + epsilon * swing + 4 * np.pi * s
    velocity = w - a * np.expm1(-delta * s) - turn * epsilon * (np.sin(turn * (start + s)) - np.sin(turn * start))
    return phi, velocity


def pressed(gear: StiffGear, wall: int, start: float, u: float, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Φ and Φ' in a contact that begins with the outward speed u."""
    states = [gear.flight(wall * gear.beta, wall * u, start, each)[:2] for each in s]
    return np.array([x for x, _ in states]), np.array([w for _, w in states])


def pieces(begin: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights over an interval."""
    edges = np.linspace(begin, end, int(np.ceil((end - begin) / LONGEST)) + 1)
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    return (middle[:, None] + half[:, None] * NODES).ravel(), (half[:, None] * WEIGHTS).ravel()


def nodes(gear: AnyGear, motion: Motion) -> Nodes:
    """Return the nodes of a periodic motion over its period, and the impacts that divide it."""
    impacts = gear.impacts(motion)
    found = []
    leaves, wall, w = motion.tau, 1, -motion.v
    for i in range(impacts.time.size):
        time, weight = pieces(leaves, impacts.time[i])
        found.append((time, weight, *flown(gear, wall, leaves, w, time - leaves)))
        wall, begin = int(impacts.wall[i]), impacts.time[i]
        leaves, w = begin + impacts.duration[i], -wall * impacts.departure[i]
        if impacts.duration[i] > 0:
            time, weight = pieces(begin, leaves)
            found.append((time, weight, *pressed(gear, wall, begin, impacts.speed[i], time - begin)))
    return Nodes(*(np.concatenate(column) for column in zip(*found, strict=True)))


def contact_force(gear: AnyGear, time: np.ndarray) -> np.ndarray:
    """The right-hand side of (2.1)."""
    turn = 2 * np.pi * time
    forcing = 4 * np.pi**2 * np.cos(turn) + 2 * np.pi * gear.delta * np.sin(turn)
    return 4 * np.pi * gear.delta - gear.epsilon * forcing


CELLS = {
    "the paper's": rattle.Gear(0.6, 0.089),
    "many impacts": rattle.Gear(0.45, 0.26, 0.3),
    "real gears": rattle.Gear(0.0021220659, 0.0003, 0.001),
    "stiff": StiffGear(0.6, 0.089, kappa=1e4),
    "soft": StiffGear(0.45, 0.2, 0.3, kappa=60.0),
}


def stable_orbits(gear: AnyGear) -> list[rattle.Attractor]:
    """The periodic attractors that a small sample finds."""
    speed = 1.65 * np.sqrt(16 * np.pi * gear.delta * gear.beta) + 2 * np.pi * gear.epsilon
    return [each for each in gear.attractors(32, speed) if each.kind == "periodic"]
