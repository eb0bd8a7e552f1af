"""All checks together."""

import rattle
from rattle.paper import forces, motions, pictures, plane
from rattle.paper.numbers import numbers
from rattle.paper.records import Finding, Number, Report, Statement

END = "chaotic attractor ends at δ = 0.762"


def report() -> Report:
    """Compute everything: about twenty seconds on one core once the library is compiled."""
    panels = pictures.panels()
    found = numbers()
    return Report(found, statements(panels, found), findings(panels))


def statements(panels: pictures.Panels, found: tuple[Number, ...]) -> tuple[Statement, ...]:
    """In the paper's order."""
    delta, epsilon = plane.cells()
    orbits, region = rattle.period_one(delta, epsilon), rattle.regions(delta, epsilon)
    end = next(number.interval[0] for number in found if number.what == END)
    return (
        *forces.formulas_that_hold(),
        *pictures.figure_4(panels),
        *pictures.figures_5_and_6(),
        *plane.figure_7(orbits, region),
        *plane.along_grazing(),
        *plane.figure_9(end),
    )


def findings(panels: pictures.Panels) -> tuple[Finding, ...]:
    """Where the paper is wrong or incomplete."""
    delta, epsilon = plane.cells()
    orbits, region = rattle.period_one(delta, epsilon), rattle.regions(delta, epsilon)
    return (
        motions.chaos_appears(),
        motions.two_points_not_one(),
        motions.stability_of_c(orbits, region),
        motions.stability_of_d(delta, epsilon, orbits, region),
        motions.multipliers_on_g1(),
        motions.region_one(),
        motions.number_of_attractors(panels),
        forces.convexity(),
        forces.impact_map(),
        forces.contact_force(),
        forces.factor_three(),
        forces.extremes_of_f(),
    )
