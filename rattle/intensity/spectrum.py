"""The order spectrum of the contact force: lines for periodic motions, a density with confidence for chaos.

An order is a frequency in units of the forcing frequency. In the impacting gear the contact force consists of impulses.
A contact of the stiff gear begins at time t with depth x = 0 and speed u, and ends at time t + d with depth 0 and speed
w. In between x'' + δx' + 2kx = h, with the stiffness k and the contact force h of rigid teeth. Therefore exactly

    ∫ 2kx e^(−iωs) ds = T(ω) (u e^(−iωt) + w e^(−iω(t + d)) + ∫ h e^(−iωs) ds),      T = 2k/(2k − ω² + iδω).

For k → ∞, where T = 1 and d = 0, the right-hand side is the impulse u + w = 2u of an elastic impact. With restitution r
the impulse is u + w = (1 + r)u, and w = 0 for an impact that begins a contact phase of duration d.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.chaos import BATCHES
from rattle.errors import RattleError, require, require_integer, require_number
from rattle.flight.forcing import TWO_PI
from rattle.intensity.forces import spectral_lines_of_force
from rattle.intensity.impacts import impacts_of_motion
from rattle.intensity.motions import Motion, checked_motion_kind
from rattle.intensity.visit import Impacts
from rattle.numerics.compile import kernel

Array = NDArray[np.float64]
MOST_ORDERS = 1 << 20
LARGEST_MATRIX = 1 << 22  # largest product of the numbers of orders and of impacts that are evaluated at once
# nodes and weights of the quadrature over a contact, accurate for orders up to about 1/(duration of the contact)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)
SEGMENTS = 8 * BATCHES  # segments of a density; neighbouring segments overlap by half


class SpectralLines(NamedTuple):
    """The force of a periodic or quiet motion, Σ_k amplitude e^(2πi order t) over orders k/m of both signs.

    order (n,) holds the orders from 0 on; amplitude (n,) is complex and dimensionless. The amplitude of a negative
    order is the complex conjugate. The force is positive in the direction of rising Φ.
    """

    order: Array
    amplitude: NDArray[np.complex128]


class SpectralDensity(NamedTuple):
    """The spectral density of the force of a chaotic motion, over orders of both signs; its integral is the power.

    order, density, low and high are (n,). low and high are the ends of the 95 % interval of the density, which is valid
    where the spectrum is smooth. The part of the force that is synchronous with the forcing adds to the
    density at whole orders, and at the orders one step of `order` below and above a whole order.
    """

    order: Array
    density: Array
    low: Array
    high: Array


def spectrum(
    motion: Motion, point: Any, stiffness: float, highest: float, resolution: int
) -> SpectralLines | SpectralDensity:
    """Return the order spectrum of the contact force (`RattlingGear.spectrum`). point: the kernels' parameter point."""
    highest = require_number("highest", highest, positive=True)
    resolution = require_integer("resolution", resolution, 4, MOST_ORDERS)
    kind = checked_motion_kind(motion)
    if kind == "undecided":
        raise RattleError(
            "the motion is undecided, so it may be a transient without a spectrum: choose a decided attractor"
        )
    spacing = 1.0 / {"quiet": 1, "periodic": motion.m, "chaotic": resolution}[kind]
    count = int(highest / spacing * (1.0 + 1e-12)) + 1
    require(
        count <= MOST_ORDERS,
        f"the spectrum would have {count:,} orders, more than {MOST_ORDERS:,}: make `highest` smaller"
        + ", or `resolution`" * (kind == "chaotic"),
    )
    order = np.asarray(spacing * np.arange(count), np.float64)
    if kind == "chaotic":
        length = float(resolution)
        impacts = impacts_of_motion(motion, point, 0.5 * (SEGMENTS + 1) * length)
        return _welch_density(impacts, order, motion.tau, length, point, stiffness)
    if kind == "quiet":
        pressing = _force_line_amplitudes(order, point)
        return SpectralLines(order, np.asarray(-wall_response(order, point.delta, stiffness) * pressing))
    impacts = impacts_of_motion(motion, point, None)
    return SpectralLines(order, np.asarray(fourier_transform_of_force(impacts, order, point, stiffness) / -motion.m))


def wall_response(order: ArrayLike, delta: float, stiffness: float) -> NDArray[np.complex128]:
    """Return T = 2k/(2k − ω² + iδω), the factor by which walls of stiffness k change the force spectrum of an impact.

    order: ω/(2π), of any shape.

    Returns
    -------
    NDArray[np.complex128]
        T, of the shape of `order`; 1 if the stiffness is infinite.
    """
    omega = TWO_PI * np.asarray(order, np.float64)
    return np.asarray(1.0 / (1.0 + (1j * delta * omega - omega * omega) / (2.0 * stiffness)))


def fourier_transform_of_force(impacts: Impacts, order: Array, point: Any, stiffness: float) -> NDArray[np.complex128]:
    """Return ∫ e^(−2πi order t) force dt at orders (n,), for the force of the impacts, positive away from Σ⁺."""
    found = np.empty(order.size, np.complex128)
    rows = max(1, LARGEST_MATRIX // max(1, impacts.time.size))
    for first in range(0, order.size, rows):
        part = slice(first, first + rows)
        found[part] = _impact_force_transforms(impacts, TWO_PI * order[part, None], point).sum(axis=1)
    return wall_response(order, point.delta, stiffness) * found


def _impact_force_transforms(impacts: Impacts, omega: Array, point: Any) -> NDArray[np.complex128]:
    """Return the Fourier transform at each ω (k, 1) of the force of each impact (n,) on a rigid wall.

    An impact at time t with the speeds u before and w after it, and the duration d, contributes
    ±(u e^(−iωt) + w e^(−iω(t + d))) + ∫ h e^(−iωs) ds, where h is the contact force. The sign is + at Σ⁺.

    Returns
    -------
    NDArray[np.complex128]
        The transforms (k, n).
    """
    begin, end = impacts.time, impacts.time + impacts.duration
    speeds = impacts.speed * np.exp(-1j * omega * begin) + impacts.departure * np.exp(-1j * omega * end)
    found = impacts.wall * speeds
    if impacts.duration.any():
        found += sum(
            size * _fourier_integrals_over_contacts(frequency - omega, begin, impacts.duration)
            for frequency, size in spectral_lines_of_force(point)
        )
    return found


def _fourier_integrals_over_contacts(frequency: Array, begin: Array, duration: Array) -> NDArray[np.complex128]:
    """Return ∫ e^(i frequency t) dt over each contact, from `begin` to `begin` + `duration`."""
    middle = begin + 0.5 * duration
    return np.asarray(duration * np.sinc(frequency * duration / TWO_PI) * np.exp(1j * frequency * middle))


def _force_line_amplitudes(order: Array, point: Any) -> NDArray[np.complex128]:
    """Return the amplitudes (n,) of the contact force at the orders 0, 1, …, n − 1; 0 where the force has no term."""
    lines = np.zeros(order.size, np.complex128)
    for frequency, size in spectral_lines_of_force(point):
        if 0 <= round(frequency / TWO_PI) < order.size:
            lines[round(frequency / TWO_PI)] = size
    return lines


def _welch_density(
    impacts: Impacts, order: Array, start: float, length: float, point: Any, stiffness: float
) -> SpectralDensity:
    """Return Welch's estimate of the force's spectral density, from half-overlapping segments with Hann's window.

    The exact train of impulses is transformed, so nothing is sampled and no order is aliased. The formula for the
    degrees of freedom, from which the interval follows, is from Percival and Walden, Spectral Analysis for Physical
    Applications (1993), section 6.17.

    Returns
    -------
    SpectralDensity
        The estimate with its 95 % interval.
    """
    from scipy.special import chdtri  # imported here because it is slow to load

    time, weight = _impulse_train(impacts, point)
    begin = start + 0.5 * length * np.arange(SEGMENTS)
    first, last = np.searchsorted(time, begin), np.searchsorted(time, begin + length)
    power = summed_periodograms(time, weight, begin, first, last, length, order.size)
    density = power / SEGMENTS * np.abs(wall_response(order, point.delta, stiffness)) ** 2
    freedom = 36.0 * SEGMENTS**2 / (19.0 * SEGMENTS - 1.0)
    low, high = (freedom / chdtri(freedom, share) for share in (0.025, 0.975))
    return SpectralDensity(order, density, low * density, high * density)


def _impulse_train(impacts: Impacts, point: Any) -> tuple[Array, Array]:
    """Return the impulses of a motion on both walls; impulses at nodes of a quadrature replace the force in a contact.

    Returns
    -------
    tuple[Array, Array]
        The times (n,), in rising order, and the sizes (n,), positive at Σ⁺.
    """
    if not impacts.duration.any():
        return impacts.time, impacts.wall * impacts.impulse
    begin, wall, half = impacts.time, impacts.wall, 0.5 * impacts.duration[:, None]
    at = begin[:, None] + half * (1.0 + NODES)
    force = sum((size * np.exp(1j * frequency * at)).real for frequency, size in spectral_lines_of_force(point))
    time = np.concatenate([begin, begin + impacts.duration, at.ravel()])
    weight = np.concatenate([wall * impacts.speed, wall * impacts.departure, (half * WEIGHTS * force).ravel()])
    rising = np.argsort(time, kind="stable")
    return time[rising], weight[rising]


@kernel
def summed_periodograms(
    time: Array, weight: Array, begin: Array, first: Array, last: Array, length: float, count: int
) -> Array:
    """Return |Σ_i weight_i window(time_i) e^(−2πik time_i/length)|²/∫ window² dt, summed over segments, for each k.

    k runs from 0 to count − 1, and the window is Hann's. Segment q begins at the time begin[q], lasts `length`, and has
    the impulses i from first[q] to last[q] − 1, of the sizes `weight` at the times `time`.

    Returns
    -------
    Array
        The sums (count,).
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
