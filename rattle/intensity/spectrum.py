"""The order spectrum of the contact force: lines of periodic motions, a density with confidence of chaos.

An order is a frequency in units of the forcing's. The contact force of the impacting gear is its impulses. In contact
the stiff gear has x'' + δx' + 2kx = h from depth 0, entered with speed u at t, to depth 0, left with w at t + d, so

    ∫ 2kx e^(−iωs) ds = T(ω) (u e^(−iωt) + w e^(−iω(t + d)) + ∫ h e^(−iωs) ds),      T = 2k/(2k − ω² + iδω),

exactly; for k → ∞, T = 1 and d = 0, these are the impulses u + w = 2u. With restitution r they are u + w = (1 + r)u,
and the impact that ends in contact, of a duration d, is left with w = 0.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.chaos import BATCHES
from rattle.errors import RattleError, require, require_integer, require_number
from rattle.flight.forcing import TWO_PI
from rattle.intensity.forces import force_lines
from rattle.intensity.impacts import impacts_of
from rattle.intensity.motions import Motion, kind_of
from rattle.intensity.visit import Impacts
from rattle.numerics.compile import kernel

Array = NDArray[np.float64]
MOST_ORDERS = 1 << 20
LARGEST_MATRIX = 1 << 22  # orders times impacts that are worked out at once
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)  # of a contact: exact up to orders of some 1/duration
SEGMENTS = 8 * BATCHES  # of a density; half as many do not overlap


class Lines(NamedTuple):
    """The force of a periodic or quiet motion: Σ_k amplitude e^(2πi order t) over orders k/m of both signs.

    order (n,): those from 0 on; amplitude (n,), complex, dimensionless; that of −order is its conjugate.
    """

    order: Array
    amplitude: NDArray[np.complex128]


class Density(NamedTuple):
    """The spectral density of the force of a chaotic motion, of both signs of the order: ∫ density is power.

    order (n,), density (n,) and its 95 % interval (n,) each, which is right where the spectrum is smooth: the part that
    keeps step with the forcing makes peaks at whole orders, five orders' spacings wide.
    """

    order: Array
    density: Array
    low: Array
    high: Array


def spectrum(motion: Motion, point: Any, stiffness: float, highest: float, resolution: int) -> Lines | Density:
    """Return the spectrum of `Rattling.spectrum`; the point is given as kernels take it."""
    highest = require_number("highest", highest, positive=True)
    resolution = require_integer("resolution", resolution, 4, MOST_ORDERS)
    kind = kind_of(motion)
    if kind == "undecided":
        raise RattleError("the motion is undecided: it may not last, and has no spectrum")
    spacing = 1.0 / {"quiet": 1, "periodic": motion.m, "chaotic": resolution}[kind]
    count = int(highest / spacing * (1.0 + 1e-12)) + 1
    require(count <= MOST_ORDERS, f"more than {MOST_ORDERS} orders: lower the highest")
    order = np.asarray(spacing * np.arange(count), np.float64)
    if kind == "chaotic":
        length = float(resolution)
        impacts = impacts_of(motion, point, 0.5 * (SEGMENTS + 1) * length)
        return _density(impacts, order, motion.tau, length, point, stiffness)
    if kind == "quiet":
        pressing = _pressing(order, point)
        return Lines(order, np.asarray(-response(order, point.delta, stiffness) * pressing))
    impacts = impacts_of(motion, point, None)
    return Lines(order, np.asarray(force_of(impacts, order, point, stiffness) / -motion.m))


def response(order: ArrayLike, delta: float, stiffness: float) -> NDArray[np.complex128]:
    """T at these orders (any shape)."""
    omega = TWO_PI * np.asarray(order, np.float64)
    return np.asarray(1.0 / (1.0 + (1j * delta * omega - omega * omega) / (2.0 * stiffness)))


def force_of(impacts: Impacts, order: Array, point: Any, stiffness: float) -> NDArray[np.complex128]:
    """∫ e^(−2πi order t) of the force that pushes away from Σ⁺ in these impacts, at orders (n,)."""
    found = np.empty(order.size, np.complex128)
    rows = max(1, LARGEST_MATRIX // max(1, impacts.time.size))
    for first in range(0, order.size, rows):
        part = slice(first, first + rows)
        found[part] = _transformed(impacts, TWO_PI * order[part, None], point).sum(axis=1)
    return response(order, point.delta, stiffness) * found


def _transformed(impacts: Impacts, omega: Array, point: Any) -> NDArray[np.complex128]:
    """Return the sum in the formula above, of each impact."""
    begin, end = impacts.time, impacts.time + impacts.duration
    speeds = impacts.speed * np.exp(-1j * omega * begin) + impacts.departure * np.exp(-1j * omega * end)
    found = impacts.wall * speeds
    if impacts.duration.any():
        found += sum(
            size * _lasting(frequency - omega, begin, impacts.duration) for frequency, size in force_lines(point)
        )
    return found


def _lasting(frequency: Array, begin: Array, duration: Array) -> NDArray[np.complex128]:
    """∫ e^(i frequency t) over the durations."""
    middle = begin + 0.5 * duration
    return np.asarray(duration * np.sinc(frequency * duration / TWO_PI) * np.exp(1j * frequency * middle))


def _pressing(order: Array, point: Any) -> NDArray[np.complex128]:
    """Return the lines of the contact force at whole orders from 0 on."""
    lines = np.zeros(order.size, np.complex128)
    for frequency, size in force_lines(point):
        if 0 <= round(frequency / TWO_PI) < order.size:
            lines[round(frequency / TWO_PI)] = size
    return lines


def _density(impacts: Impacts, order: Array, start: float, length: float, point: Any, stiffness: float) -> Density:
    """Return Welch's estimate over half overlapping segments under Hann's window.

    The transform is of the train itself, so that nothing is sampled and no order is folded onto another. Degrees of
    freedom: Percival and Walden, Spectral Analysis for Physical Applications (1993), section 6.17.

    Returns
    -------
    Density
        With its degrees of freedom, from which its confidence follows.
    """
    from scipy.special import chdtri  # takes longer to load than all else here

    time, weight = _pushes(impacts, point)
    begin = start + 0.5 * length * np.arange(SEGMENTS)
    first, last = np.searchsorted(time, begin), np.searchsorted(time, begin + length)
    power = periodograms(time, weight, begin, first, last, length, order.size)
    density = power / SEGMENTS * np.abs(response(order, point.delta, stiffness)) ** 2
    freedom = 36.0 * SEGMENTS**2 / (19.0 * SEGMENTS - 1.0)
    low, high = (freedom / chdtri(freedom, share) for share in (0.025, 0.975))
    return Density(order, density, low * density, high * density)


def _pushes(impacts: Impacts, point: Any) -> tuple[Array, Array]:
    """Return when and how much the walls push (n,), by rising times; a contact's force at a few nodes of it."""
    if not impacts.duration.any():
        return impacts.time, impacts.wall * impacts.impulse
    begin, wall, half = impacts.time, impacts.wall, 0.5 * impacts.duration[:, None]
    at = begin[:, None] + half * (1.0 + NODES)
    force = sum((size * np.exp(1j * frequency * at)).real for frequency, size in force_lines(point))
    time = np.concatenate([begin, begin + impacts.duration, at.ravel()])
    weight = np.concatenate([wall * impacts.speed, wall * impacts.departure, (half * WEIGHTS * force).ravel()])
    rising = np.argsort(time, kind="stable")
    return time[rising], weight[rising]


@kernel
def periodograms(
    time: Array, weight: Array, begin: Array, first: Array, last: Array, length: float, count: int
) -> Array:
    """Return |∫ window e^(−2πikt/length) of impulses|²/∫ window², summed over the segments, at k (count,).

    Impulses of segment q are first[q] to last[q]; they begin at begin[q].

    Returns
    -------
    Array
        (count,), summed over segments.
    """
    power, real, imaginary = np.zeros(count), np.empty(count), np.empty(count)
    for q in range(begin.size):
        real[:], imaginary[:] = 0.0, 0.0
        for i in range(first[q], last[q]):
            angle = TWO_PI * (time[i] - begin[q]) / length
            a, b = weight[i] * math.sin(0.5 * angle) ** 2, 0.0
            c, s = math.cos(angle), -math.sin(angle)
            for k in range(count):
                real[k] += a
                imaginary[k] += b
                a, b = a * c - b * s, a * s + b * c
        for k in range(count):
            power[k] += real[k] * real[k] + imaginary[k] * imaginary[k]
    return np.asarray(power / (0.375 * length))
