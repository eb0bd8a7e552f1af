"""Load or compile kernels now, so that later calls do not pay for it."""

from rattle.impacting.bifurcations.codimension_two import robust_chaos_interval
from rattle.impacting.gear import Gear
from rattle.impacting.orbits.period_one import grazing


def warm_up(kappa: float | None = None) -> None:
    """Run every kernel that a survey needs: compiled in a quarter of a minute, or loaded from the disk cache at once.

    Of the impacting gear, or of the stiff one with this stiffness; without boundary distance, basins, Γ, manifolds and
    curves, which compile when first used.
    """
    if kappa is None:
        _impacting()
    else:
        _stiff(kappa)


def _impacting() -> None:
    gear = Gear(0.6, 0.1)
    gear.orbits()
    gear.attractors(count=16)
    grazing("G1", 0.6)
    robust_chaos_interval()


def _stiff(kappa: float) -> None:
    from rattle.stiff import StiffGear  # not for who has no use for it

    gear = StiffGear(0.6, 0.1, kappa=kappa)
    gear.orbits()
    gear.attractors(count=16)
