"""Compute how hard the motions of a point rattle, in other processes: intensities, order spectra, sounds."""

from __future__ import annotations

from collections.abc import Sequence

import rattle
from rattle import SpectralDensity, SpectralLines
from rattle.intensity import wav
from rattle.models import AnyGear

HIGHEST_SPECTRUM_ORDER = 24.0  # highest order of a spectrum
SECONDS, RATE = 3.0, 22050  # length of a sound in seconds, and its samples per second


def motion_intensities(gear: AnyGear, attractors: Sequence[rattle.Attractor]) -> tuple[rattle.Intensity | None, ...]:
    """Return the intensity of each attractor; None for a motion that cannot be followed.

    For the entry of undecided samples (kind "undecided") the values of the intensity are NaN.

    Returns
    -------
    tuple[rattle.Intensity | None, ...]
        The intensities, in the order of `attractors`.
    """
    return tuple(_intensity_of(gear, each) for each in attractors)


def _intensity_of(gear: AnyGear, attractor: rattle.Attractor) -> rattle.Intensity | None:
    try:
        return gear.intensity(attractor)
    except rattle.RattleError:  # for example, the motion is too close to grazing or to rest
        return None


def spectrum_of_attractor(gear: AnyGear, attractor: rattle.Attractor) -> SpectralLines | SpectralDensity:
    """Return the spectral lines of a periodic or quiet motion, or the spectral density of a chaotic motion.

    Returns
    -------
    SpectralLines | SpectralDensity
        Spectrum of the force between the teeth.

    Raises
    ------
    RattleError
        The motion cannot be followed from its state (τ, v), for instance because it comes to rest; or `attractor` is
        the entry of undecided samples.
    """
    return gear.spectrum(attractor, HIGHEST_SPECTRUM_ORDER)


def sound_file_bytes(gear: AnyGear, attractor: rattle.Attractor, rpm: float) -> bytes:
    """Return the motion as a WAV file, scaled to full volume; silence for quiet motion. rpm: speed of the machine."""
    return wav(gear.sound(attractor, rpm, SECONDS, RATE), RATE)


def load_sound_kernels(gear: AnyGear) -> None:
    """Load the kernels of intensities, spectra and sounds, by computing each of them once."""
    found = gear.attractors(16)
    motion_intensities(gear, found)
    for each in found:
        if each.kind != "undecided":
            gear.spectrum(each, 1.0, 4)
            gear.sound(each, 3000.0, 0.01)
