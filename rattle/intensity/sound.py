"""Synthesise the sound of a motion: each impact excites a damped oscillation in proportion to its impulse."""

import io
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.errors import require, require_integer, require_number
from rattle.flight.forcing import TWO_PI
from rattle.intensity.impacts import impacts_of_motion
from rattle.intensity.motions import Motion
from rattle.numerics.compile import kernel

Array = NDArray[np.float64]
MOST_SAMPLES = 50_000_000
LOUDEST = 32767 * 9 // 10  # value of a 16-bit sample at full volume: 90 % of the largest value


def sound(
    motion: Motion, point: Any, stiffness: float, rpm: float, seconds: float, rate: int, ring: float, decay: float
) -> NDArray[np.float64]:
    """Return the sound of a motion (`RattlingGear.sound`). point: the gear's parameter point for kernels."""
    rpm, seconds = require_number("rpm", rpm, positive=True), require_number("seconds", seconds, positive=True)
    ring, decay = require_number("ring", ring, positive=True), require_number("decay", decay, positive=True)
    rate = require_integer("rate", rate, 1, MOST_SAMPLES)
    require(ring < 0.5 * rate, f"ring must be below half the rate of {rate} Hz, got {ring:g} Hz: choose a higher rate")
    require(
        seconds * rate <= MOST_SAMPLES,
        f"{seconds:g} seconds at {rate:,} samples a second exceed the limit of {MOST_SAMPLES:,} samples: give fewer "
        "seconds, or a lower rate",
    )
    turn = 60.0 / rpm
    impacts = impacts_of_motion(motion, point, seconds / turn)
    # on rigid walls the force of a contact phase is static and makes no sound
    strikes = impacts.speed + impacts.departure if math.isinf(stiffness) else impacts.impulse
    return np.asarray(
        synthesize_ringing((impacts.time - motion.tau) * turn, strikes, round(seconds * rate), rate, ring, decay)
    )


@kernel
def synthesize_ringing(time: Array, size: Array, count: int, rate: float, ring: float, decay: float) -> Array:
    """Return `count` samples of Σ size e^(−s/decay) sin(2π ring s), a sum over the impacts before each sample.

    s is the time since an impact. time, decay: in seconds. rate, ring: in Hz. The times of the impacts must rise.
    size: the impulses of the impacts.

    Returns
    -------
    Array
        The samples (count,).
    """
    heard, x, y, j = np.empty(count), 0.0, 0.0, 0
    fade = math.exp(-1.0 / (decay * rate))
    c, s = fade * math.cos(TWO_PI * ring / rate), fade * math.sin(TWO_PI * ring / rate)
    for i in range(count):
        x, y = x * c - y * s, x * s + y * c
        while j < time.size and time[j] <= i / rate:
            since = i / rate - time[j]
            left = size[j] * math.exp(-since / decay)
            x += left * math.cos(TWO_PI * ring * since)
            y += left * math.sin(TWO_PI * ring * since)
            j += 1
        heard[i] = y
    return heard


def wav(signal: Array, rate: int, full_scale: float | None = None) -> bytes:
    """Return a 16-bit WAV file of a signal (n,). A value of size `full_scale` has full volume.

    By default `full_scale` is the largest size of a value in the signal.

    Returns
    -------
    bytes
        One channel with its header.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    from scipy.io import wavfile  # imported here because it takes a tenth of a second to load

    if full_scale is None:
        full_scale = float(np.abs(signal).max(initial=0.0)) or 1.0
    scaled = LOUDEST / require_number("full_scale", full_scale, positive=True) * signal
    file = io.BytesIO()
    wavfile.write(file, rate, np.clip(np.rint(scaled), -LOUDEST, LOUDEST).astype(np.int16))
    return file.getvalue()
