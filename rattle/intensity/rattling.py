"""Base class of gears with the methods that measure how hard motions rattle."""

import math
from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.intensity.impacts import impacts_of_motion
from rattle.intensity.intensity import Intensity, intensity
from rattle.intensity.motions import Motion
from rattle.intensity.sound import sound
from rattle.intensity.spectrum import SpectralDensity, SpectralLines, spectrum
from rattle.intensity.visit import Impacts


class RattlingGear(ABC):
    """Base class with the methods that measure how hard a gear's motions rattle.

    A motion is given as an `Attractor`, an `Orbit` or a periodic motion of the gear.
    """

    @property
    @abstractmethod
    def _point(self) -> Any:
        """The gear's parameter point for kernels."""

    @property
    def _stiffness(self) -> float:
        """The stiffness of the walls; inf for rigid walls."""
        return math.inf

    def intensity(self, motion: Motion, periods: float | None = None) -> Intensity:
        """Return how hard a motion rattles: impacts, speeds and energy per forcing period.

        Parameters
        ----------
        motion
            A motion of this gear. A periodic motion is evaluated over one period, to rounding. A chaotic motion is
            followed from its (τ, v) on, with error bars from 32 batches. A quiet motion has no impacts.
        periods : float, optional
            Forcing periods for which a chaotic motion is followed; by default 32,000, or 320/δ if this is more.

        Returns
        -------
        Intensity
            Dimensionless numbers per forcing period, with error bars, which are 0 for periodic and quiet motions.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        RattleError
            If the motion does not belong to this gear, comes to rest, or cannot be followed for so long.
        """
        return intensity(motion, self._point, periods)

    def impacts(self, motion: Motion, periods: float | None = None) -> Impacts:
        """Return the impacts of a motion on both walls over `periods` forcing periods from the departure (τ, v) on.

        By default a periodic motion is followed for its period; other motions that have impacts need `periods`. In a
        chatter that ends in contact, the infinitely many weakest impacts are listed as one impact, which has the
        duration of the contact phase. The method raises the same exceptions as `intensity`.

        Returns
        -------
        Impacts
            Arrays (n,), of length 0 if the motion is quiet.
        """
        return impacts_of_motion(motion, self._point, periods)

    def spectrum(self, motion: Motion, highest: float = 32.0, resolution: int = 64) -> SpectralLines | SpectralDensity:
        """Return the order spectrum of the contact force, from order 0 to the highest.

        A periodic or quiet motion has exact lines. For elastic impacts at ±β a line has the amplitude (1/m) Σ ∓2v
        e^(−2πi order t), summed over the impacts of a period; the amplitude of order 0 is −4πδ(1 + load). A chaotic
        motion has a density at steps of 1/resolution, with a 95 % interval, from 256 segments of `resolution` forcing
        periods. The method raises the same exceptions as `intensity`, and RattleError for an undecided motion.

        Returns
        -------
        SpectralLines | SpectralDensity
            `SpectralLines` for a periodic or quiet motion, a `SpectralDensity` for a chaotic motion.
        """
        return spectrum(motion, self._point, self._stiffness, highest, resolution)

    def sound(
        self,
        motion: Motion,
        rpm: float,
        seconds: float = 5.0,
        rate: int = 44100,
        ring: float = 2000.0,
        decay: float = 0.005,
    ) -> NDArray[np.float64]:
        """Return the sound of a motion at `rpm` revolutions per minute, from the departure (τ, v) on.

        Each impact rings at `ring` Hz and decays by a factor e in `decay` seconds; its loudness is its dimensionless
        impulse. The transfer path of a gearbox is not modelled. A quiet motion gives silence. The method raises the
        same exceptions as `intensity`.

        Returns
        -------
        NDArray[np.float64]
            Samples (seconds · rate,).
        """
        return sound(motion, self._point, self._stiffness, rpm, seconds, rate, ring, decay)
