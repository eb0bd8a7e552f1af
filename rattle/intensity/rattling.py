"""Methods of every gear that measure how hard its motions rattle."""

import math
from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.intensity.impacts import impacts_of
from rattle.intensity.intensity import Intensity, intensity
from rattle.intensity.motions import Motion
from rattle.intensity.sound import sound
from rattle.intensity.spectrum import Density, Lines, spectrum
from rattle.intensity.visit import Impacts


class Rattling(ABC):
    """Base class with the methods that measure how hard a gear's motions rattle.

    A motion is given as one of the gear's `Attractor`, `Orbit` or periodic motions.
    """

    @property
    @abstractmethod
    def _point(self) -> Any:
        """Return the gear's parameters for kernels."""

    @property
    def _stiffness(self) -> float:
        """Return the stiffness of the walls."""
        return math.inf

    def intensity(self, motion: Motion, periods: float | None = None) -> Intensity:
        """Return how hard a motion rattles: impacts, speeds and energy per forcing period.

        Parameters
        ----------
        motion
            A motion of this gear. A periodic one is evaluated over one period, to rounding. A chaotic one is followed
            from its (τ, v), with error bars from 32 batches. A quiet one has no impacts.
        periods : float, optional
            Forcing periods for which chaos is followed; by default 32,000, or 320/δ if that is more.

        Returns
        -------
        Intensity
            Dimensionless, per forcing period; error bars are 0 for periodic and quiet motions.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        RattleError
            If the motion does not belong to this gear, or comes to rest.
        """
        return intensity(motion, self._point, periods)

    def impacts(self, motion: Motion, periods: float | None = None) -> Impacts:
        """Return the impacts of a motion on both walls over `periods` forcing periods from the departure (τ, v) on.

        The default for a periodic motion is its period. A chatter that ends in contact is listed down to rounding; its
        last impact has the duration of the contact phase. Errors are those of `intensity`.

        Returns
        -------
        Impacts
            Arrays (n,), or None if the motion is quiet.
        """
        return impacts_of(motion, self._point, periods)

    def spectrum(self, motion: Motion, highest: float = 32.0, resolution: int = 64) -> Lines | Density:
        """Return the order spectrum of the contact force, from order 0 to the highest.

        A periodic or quiet motion has exact lines. For elastic impacts at ±β the amplitude is (1/m) Σ ∓2v e^(−2πi order
        t); that of order 0 is −4πδ(1 + load). A chaotic motion has a density at steps of 1/resolution with its
        confidence, from 256 segments of `resolution` forcing periods. Errors are those of `intensity`.

        Returns
        -------
        Lines | Density
            `Lines` of a periodic or quiet motion, the `Density` of a chaotic one.
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
        """Return the sound of a motion at a speed of rotation, from the departure (τ, v) on.

        Each impact rings at `ring` Hz and decays by a factor e in `decay` seconds; its loudness is its dimensionless
        impulse. The transfer path of a gearbox is not modelled. A quiet motion gives silence. Errors are those of
        `intensity`.

        Returns
        -------
        NDArray[np.float64]
            Samples (seconds · rate,).
        """
        return sound(motion, self._point, self._stiffness, rpm, seconds, rate, ring, decay)
