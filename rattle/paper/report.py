"""Run all checks of the paper, or one finding."""

from collections.abc import Callable
from functools import cache

import rattle
from rattle.errors import require
from rattle.paper import forces, motions, pictures, plane
from rattle.paper.numbers import paper_numbers
from rattle.paper.records import Finding, Report, StatedNumber, Statement

#: Name, in `numbers.STATED`, of the ε up to which the statements about Figure 9 hold.
END = "chaotic attractor ends at δ = 0.762"


def report() -> Report:
    """Compute the whole report, which takes about twenty seconds on one core with compiled kernels."""
    panels = pictures.compute_figure_4_attractors()
    found = paper_numbers()
    return Report(found, compute_statements(panels, found), compute_findings(panels))


def compute_statements(panels: pictures.Panels, found: tuple[StatedNumber, ...]) -> tuple[Statement, ...]:
    """Compute all statements, in the paper's order. found: the numbers of the paper with their computed values."""
    delta, epsilon = plane.plane_cell_centres()
    orbits, region = rattle.period_one(delta, epsilon), rattle.regions(delta, epsilon)
    end = next(number.interval[0] for number in found if number.what == END)
    return (
        *forces.formula_statements(),
        *pictures.figure_4_statements(panels),
        *pictures.figures_5_and_6_statements(),
        *plane.figure_7_statements(orbits, region),
        *plane.grazing_statements(),
        *plane.figure_9_statements(end),
    )


def compute_findings(panels: pictures.Panels) -> tuple[Finding, ...]:
    """Compute all findings: where the paper is wrong or incomplete."""
    return tuple(compute() for compute in _functions_of_findings(lambda: panels))


def compute_finding(number: int) -> Report:
    """Compute one finding, by its number in the report, and the numbers that it explains.

    Returns
    -------
    Report
        A report with this finding alone.

    Raises
    ------
    ParameterError
        If there is no finding with this number.
    """
    known = _functions_of_findings(pictures.compute_figure_4_attractors)
    require(1 <= number <= len(known), f"there is no finding {number}: choose a number from 1 to {len(known)}")
    found = known[number - 1]()
    return Report(paper_numbers(found.key), (), (found,), number)


def _functions_of_findings(panels: Callable[[], pictures.Panels]) -> tuple[Callable[[], Finding], ...]:
    """Return the functions that compute the findings, in the report's order; `panels` computes Figure 4's panels."""
    cells = cache(plane.plane_cell_centres)
    orbits, region = cache(lambda: rattle.period_one(*cells())), cache(lambda: rattle.regions(*cells()))
    return (
        motions.finding_on_birth_of_chaos,
        motions.finding_on_cod23,
        lambda: motions.finding_on_stability_of_c(orbits(), region()),
        lambda: motions.finding_on_stability_of_d(*cells(), orbits(), region()),
        motions.finding_on_g1_multipliers,
        motions.finding_on_region_one,
        lambda: motions.finding_on_number_of_attractors(panels()),
        forces.finding_on_convexity,
        forces.finding_on_impact_map,
        forces.finding_on_contact_force,
        forces.finding_on_factor_three,
        forces.finding_on_extremes_of_f,
    )
