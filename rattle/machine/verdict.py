"""The verdict on a machine: quiet, quiet unless knocked, rattling from some initial conditions, or always rattling."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from rattle.attractors.speeds import NATURAL, highest_sampled_speed
from rattle.attractors.table import Attractor
from rattle.errors import require_integer
from rattle.machine.conversion import Units
from rattle.numerics.sampling import wilson_interval

if TYPE_CHECKING:
    from rattle.models import AnyGear

QUIET, KNOCKED, SOMETIMES, ALWAYS = VERDICTS = ("quiet", "quiet_unless_knocked", "rattles_sometimes", "always_rattles")
#: Numbers of phases and of speeds of the knocks in a round, and number of rounds after the first. The speeds of a later
#: round reach up to the speed of the weakest knock that has ended quiet running so far.
PHASES, SPEEDS, ROUNDS = 32, 64, 2
#: Speed of the hardest knock that is tried, divided by the natural speed.
HARDEST = 3.0
MOST_COUNT = 65_536


class MachineVerdict(NamedTuple):
    """The answer to the question whether a machine rattles; `str` gives it in one line.

    Attributes
    ----------
    kind
        "quiet", "quiet_unless_knocked", "rattles_sometimes" or "always_rattles".
    share
        The share of random initial conditions that lead to rattling.
    low, high
        The 95 % interval of this share, in which undecided initial conditions may count either way.
    knock
        The speed of the weakest knock, at the worst phase, after which teeth at rest rattle for ever, in m/s along the
        line of action; inf if no knock up to `hardest` has this effect, 0 if teeth cannot rest.
    hardest
        The speed of the hardest knock that was tried, m/s.
    undecided
        The share of random initial conditions that stayed undecided: their attractor is not known.
    """

    kind: str
    share: float
    low: float
    high: float
    knock: float
    hardest: float
    undecided: float = 0.0

    def __str__(self) -> str:
        """Return the verdict in one line."""
        if self.kind == ALWAYS:
            return "always rattles: the force between the teeth changes its sign"
        doubt = f"; {100 * self.undecided:.2g} % of starts stayed undecided" if self.undecided else ""
        if self.kind == QUIET:
            return f"quiet: no knock up to {self.hardest:.2g} m/s makes it rattle{doubt}"
        if self.kind == KNOCKED:
            return f"quiet unless knocked with {self.knock:.2g} m/s{doubt}"
        interval = f"95 %: {100 * self.low:.0f} to {100 * self.high:.0f} %"
        knock = "" if np.isinf(self.knock) else f"; at rest it takes a knock of {self.knock:.2g} m/s"
        return f"rattles from {100 * self.share:.0f} % of starts ({interval}){knock}{doubt}"


class MachineLike(Protocol):
    """The properties and methods of a machine that `machine_verdict` needs."""

    @property
    def gear(self) -> AnyGear:
        """The gear at the machine's parameter point."""

    @property
    def units(self) -> Units:
        """The SI sizes of the model's units."""

    def attractors(self, count: int = 256, seed: int = 0) -> tuple[Attractor, ...]:
        """Return the attractors of the machine's gear."""


def machine_verdict(machine: MachineLike, count: int, seed: int) -> MachineVerdict:
    """Return the verdict on a machine from `count` random initial conditions (`Machine.verdict`)."""
    count = require_integer("count", count, 1, MOST_COUNT)
    gear, unit = machine.gear, float(machine.units.velocity)
    hardest = HARDEST * highest_sampled_speed(NATURAL, gear.delta, gear.epsilon, gear.beta)
    if gear.epsilon >= gear.quiet_limit:
        return MachineVerdict(ALWAYS, 1.0, 1.0, 1.0, 0.0, unit * hardest)
    found = machine.attractors(count, seed)
    rattling, open_ = (
        round(count * sum(each.fraction for each in found if of(each))) for of in (_is_rattling, _is_undecided)
    )
    low, high = wilson_interval(rattling, count)[0], wilson_interval(rattling + open_, count)[1]
    knock = least_rattling_knock_speed(machine, hardest)
    kind = SOMETIMES if rattling else QUIET if np.isinf(knock) else KNOCKED
    share, undecided = rattling / count, open_ / count
    return MachineVerdict(kind, share, float(low), float(high), unit * knock, unit * hardest, undecided)


def least_rattling_knock_speed(machine: MachineLike, hardest: float) -> float:
    """Return the speed of the weakest knock that makes resting teeth rattle for ever, in the model's unit of speed.

    hardest: the speed of the hardest knock that is tried, in the same unit.

    In each round PHASES × SPEEDS knocks are followed: in the first round with speeds up to `hardest`, in each of the
    ROUNDS further rounds up to the weakest effective speed so far. Narrow ranges of effective speeds may be missed.

    Returns
    -------
    float
        The speed; inf if no knock has this effect.
    """
    gear, limit, least = machine.gear, hardest, np.inf
    phases = (np.arange(PHASES) + 0.5) / PHASES
    for _ in range(1 + ROUNDS):
        speeds = limit * np.arange(1, SPEEDS + 1) / SPEEDS
        reached = gear.reached(phases[:, None], speeds)
        rattles = np.array([_is_rattling(each) for each in reached.attractors])[reached.which].any(axis=0)
        if not rattles.any():
            return float(least)
        least = limit = float(speeds[np.argmax(rattles)])
    return float(least)


def _is_rattling(attractor: Attractor) -> bool:
    """Return whether the teeth rattle on an attractor, because it is periodic or chaotic."""
    return attractor.kind in ("periodic", "chaotic")


def _is_undecided(attractor: Attractor) -> bool:
    """Return whether an entry of a list of attractors is no attractor, but stands for all undecided samples."""
    return attractor.kind == "undecided"
