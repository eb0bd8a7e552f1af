"""Load or compile every kernel now, so that later calls do not pay for it."""

from rattle.curves.codimension import robust_chaos_interval
from rattle.gear import Gear
from rattle.grazing import grazing
from rattle.iterate import iterate_tangent


def warm_up(kappa: float | None = None) -> None:
    """Run every kernel once, but those of basins and Γ, which compile when first used (seconds when they must be
    compiled, well under a second from the disk cache). With a stiffness kappa also what surveys of the stiff gear need.
    """
    if kappa is not None:
        from rattle.stiff import StiffGear, trace  # not for who has no use for it

        stiff = StiffGear(0.6, 0.1, kappa=kappa)
        stiff.attractors(count=16)
        stiff.orbits()
        stiff.basins(20)
        stiff.trajectory(0.3, 4.0, 1.0)
        trace("SN1", 0.6, kappa, (0.55, 0.6), (0.0, 0.2))
    gear = Gear(0.6, 0.1)
    gear.attractors(count=16)
    step = gear.impact(0.3, 4.0)
    gear.inverse_impact(step.tau, step.v)
    gear.iterate(0.3, 4.0, 1)
    iterate_tangent(0.6, 0.1, 0.3, 4.0, 1)
    gear.first_impact(1, 0.3, -4.0)
    gear.orbits()
    grazing("G1", 0.6)
    robust_chaos_interval()
