"""All checks together."""

from collections.abc import Callable
from functools import cache

import rattle
from rattle.errors import require
from rattle.paper import forces, motions, pictures, plane
from rattle.paper.numbers import paper_numbers
from rattle.paper.records import Finding, Number, Report, Statement

END = "chaotic attractor ends at δ = 0.762"


def report() -> Report:
    """Compute everything: about twenty seconds on one core once the library is compiled."""
    panels = pictures.compute_panels()
    found = paper_numbers()
    return Report(found, statements(panels, found), findings(panels))


def statements(panels: pictures.Panels, found: tuple[Number, ...]) -> tuple[Statement, ...]:
    """Return the statements in the paper's order."""
    delta, epsilon = plane.plane_cells()
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
    """Return the findings: where the paper is wrong or incomplete."""
    return tuple(compute() for compute in _findings(lambda: panels))


def one_finding(number: int) -> Report:
    """Compute one finding, by its number in the report, and the numbers that it explains. Raises ParameterError."""
    known = _findings(pictures.compute_panels)
    require(1 <= number <= len(known), f"there is no finding {number}: there are 1 to {len(known)}")
    found = known[number - 1]()
    return Report(paper_numbers(found.key), (), (found,), number)


def _findings(panels: Callable[[], pictures.Panels]) -> tuple[Callable[[], Finding], ...]:
    """Return the computation of each finding, in order; shared values are computed once, if at all."""
    cells = cache(plane.plane_cells)
    orbits, region = cache(lambda: rattle.period_one(*cells())), cache(lambda: rattle.regions(*cells()))
    return (
        motions.chaos_appears,
        motions.two_points_not_one,
        lambda: motions.stability_of_c(orbits(), region()),
        lambda: motions.stability_of_d(*cells(), orbits(), region()),
        motions.multipliers_on_g1,
        motions.region_one,
        lambda: motions.number_of_attractors(panels()),
        forces.convexity,
        forces.impact_map,
        forces.contact_force_statement,
        forces.factor_three,
        forces.extremes_of_f,
    )
