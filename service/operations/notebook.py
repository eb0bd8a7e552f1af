"""Write a Jupyter notebook that computes what the explorer shows of a parameter point."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import rattle
from gear_rattle.service.operations.diagrams import COUNT, Pair, default_steps
from rattle import Machine
from rattle.models import AnyGear, Capability, model_of_gear

POINT_SAMPLES, BASIN_CELLS = 1024, 300  # initial conditions for the attractors; cells along each axis of the basins
PACKAGE = "gear-rattle"
TITLE = """# What runs at δ = {gear.delta:g}, ε = {gear.epsilon:g}

{kind} with {model}, made by {package} {version}, which computes the same numbers anywhere:

    pip install '{package}[plot]=={version}'"""
FINENESS = """# initial conditions of the attractors, cells of the basins a side
starts, side = {starts}, {side}
# points of the parameter in the diagram, and initial conditions
steps, count = {steps}, {count}"""
BASINS = """import matplotlib.pyplot as plt
from rattle.plot.basins import draw_basins
from rattle.plot.colours import Palette

basins = gear.basins(side, None, "refined")
figure, axes = plt.subplots()
draw_basins(axes, basins, Palette())
axes.set(xlabel="phase τ", ylabel="speed v")
basins"""
DIAGRAM = """from rattle.plot import diagram_figure

diagram = model.diagram({start}, {end}, steps, count)
diagram_figure(diagram)"""


def create_notebook(gear: AnyGear, machine: Machine | None, ends: tuple[Pair, Pair]) -> dict[str, Any]:
    """Return a notebook (nbformat 4.5) that computes attractors, basins and a bifurcation diagram.

    machine: the machine with the parameters of `gear`; None for dimensionless numbers. ends: the points (δ, ε) where
    the diagram begins and ends. The numbers in the notebook are equal to those of the gear to the last bit.

    Returns
    -------
    dict[str, Any]
        The notebook as a JSON object.
    """
    cells: list[dict[str, Any]] = [
        {"id": name, "cell_type": kind, "metadata": {}, "source": source.splitlines(keepends=True)}
        | ({"execution_count": None, "outputs": []} if kind == "code" else {})
        for name, kind, source in _notebook_cells(gear, machine, ends)
    ]
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}


def _notebook_cells(gear: AnyGear, machine: Machine | None, ends: tuple[Pair, Pair]) -> Iterator[tuple[str, str, str]]:
    """Yield for each cell of the notebook: its name, its kind ("code" or "markdown"), and its text."""
    version = rattle.__version__
    made = TITLE.format(
        gear=gear, kind=type(gear).__name__, model=model_of_gear(gear), package=PACKAGE, version=version
    )
    yield "title", "markdown", made
    yield "point", "code", _python_code_of_point(gear, machine)
    fineness = {"starts": POINT_SAMPLES, "side": BASIN_CELLS, "steps": default_steps(gear), "count": COUNT}
    yield "fineness", "code", FINENESS.format(**fineness)
    region = "" if gear.parameters.harmonics else "print('region', rattle.REGIONS[gear.region()])\n"
    yield "orbits", "code", f"{region}gear.orbits()"
    yield "attractors", "code", "attractors = gear.attractors(starts)\nattractors"
    yield "basins", "code", BASINS
    if Capability.DIAGRAMS in model_of_gear(gear).has:
        yield "diagram", "code", DIAGRAM.format(start=ends[0], end=ends[1])
        yield "events", "code", "diagram.events"


def _python_code_of_point(gear: AnyGear, machine: Machine | None) -> str:
    if machine is not None:
        numbers = ", ".join(f"{each.name}={getattr(machine, each.name)!r}" for each in fields(machine))
        return (
            "import rattle\nfrom rattle.models import model_of_gear\n\n"
            f"machine = rattle.Machine({numbers})\ngear = machine.gear\nmodel = model_of_gear(gear)\ngear"
        )
    model = model_of_gear(gear)
    parameters = ", ".join([repr(gear.beta), *(f"{each.name}={model.numbers[each.name]!r}" for each in model.added)])
    names = ", ".join(each.long_name for each in model.parameters())
    made = f"model = model_of({parameters})  # {names}\n"
    imported = "model_of"
    if harmonics := gear.parameters.harmonics:
        imported += ", with_harmonics"
        made += f"model = with_harmonics(model, {list(harmonics)!r})\n"
    return (
        f"import rattle\nfrom rattle.models import {imported}\n\n"
        f"{made}"
        f"gear = model.gear({gear.delta!r}, {gear.epsilon!r})\ngear"
    )
