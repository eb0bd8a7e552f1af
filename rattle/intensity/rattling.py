"""Answer questions about the impacts of a motion, for any gear."""

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
    """A gear whose motions rattle. A motion is one of its `Attractor`, `Orbit` or periodic motions."""

    @property
    @abstractmethod
    def _point(self) -> Any:
        """Return the gear's parameters, as kernels take them."""

    @property
    def _stiffness(self) -> float:
        """The stiffness of its walls."""
        return math.inf

    def intensity(self, motion: Motion, periods: float | None = None) -> Intensity:
        """Return how hard a motion rattles: impacts, speeds and energy per forcing period.

        Periodic: over one period, to rounding. Chaotic: over a watch of so many forcing periods (by default 32,000, or
        320/δ if that is more) from its (τ, v) on, with error bars from 32 batches of it. Quiet: nothing. Raises
        ParameterError, and RattleError where the motion is none of this gear's or comes to rest.

        Returns
        -------
        Intensity
            Dimensionless, per forcing period; error bars are 0 where a motion is periodic or quiet.
        """
        return intensity(motion, self._point, periods)

    def impacts(self, motion: Motion, periods: float | None = None) -> Impacts:
        """Return the impacts of a motion on both walls in this number of forcing periods from the departure (τ, v) on.

        For a periodic motion the default is its period. Of a chatter that ends in contact, the impacts are those above
        rounding, the last of which has the contact phase for its duration. Raises the errors of `intensity`.

        Returns
        -------
        Impacts
            Arrays (n,), or None if the motion is quiet.
        """
        return impacts_of(motion, self._point, periods)

    def spectrum(self, motion: Motion, highest: float = 32.0, resolution: int = 64) -> Lines | Density:
        """Return the order spectrum of the contact force, from order 0 to the highest.

        Periodic or quiet: its lines, exact, that of order 0 being −4πδ(1 + load): over elastic impacts at ±β amplitude
        = (1/m) Σ ∓2v e^(−2πi order t). Chaotic: its density every 1/resolution, with its confidence, from 256 segments
        of `resolution` forcing periods. Raises as `intensity`.

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
        """Return the sound of a motion at this speed, from the departure (τ, v) on.

        Each impact rings at `ring` Hz and dies away by e in `decay` seconds, as loud as its impulse (dimensionless).
        What a gearbox makes of it is another matter. Quiet: silence. Raises as `intensity`.

        Returns
        -------
        NDArray[np.float64]
            Samples (seconds · rate,).
        """
        return sound(motion, self._point, self._stiffness, rpm, seconds, rate, ring, decay)
