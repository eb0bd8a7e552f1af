"""Compute small pieces of work, so that every kernel that the service needs of a model is compiled."""

from __future__ import annotations

import numpy as np

import rattle
from gear_rattle.service.explorer.point import parts
from gear_rattle.service.operations.points import curves_document, intensities, orbits_document
from rattle.attractors import BUDGET, SampleSpec
from rattle.families import joined
from rattle.models import Capability
from rattle.numerics import compile_apart
from rattle.precompile import Steps, example_of, survey

AT = 0.6, 0.1  # δ, ε of the gear that is computed for its kernels


def orbits(name: str) -> Steps:
    """Return what needs the kernels of period-one motions and limits."""
    return {"closed forms": lambda: orbits_document(example_of(name).gear(*AT))}


def curves(name: str) -> Steps:
    """Return what needs the kernels of curves."""
    delta, _ = AT
    return {"curves": lambda: curves_document(example_of(name), (0.99 * delta, delta), (0.0, 0.2))}


def attractors(name: str) -> Steps:
    """Return what needs the kernels of attractors, beside those of a survey."""
    model = example_of(name)

    def attractors_at() -> None:
        intensities(model.gear(*AT), 16, None, 0, BUDGET)
        delta, epsilon = np.array(AT[:1]), np.array(AT[1:])
        joined(
            delta,
            epsilon,
            16,
            model.attractors_of(delta, epsilon[:, None], SampleSpec(16)),
            model.cells(delta, epsilon),
        )

    return {"attractors of a point": attractors_at}


def point(name: str) -> Steps:
    """Return what needs the kernels of the view of a point, and of the estimate of a survey with basins."""
    model = example_of(name)
    crises: Steps = {"crises": lambda: rattle.crisis_side(*AT)} if Capability.CRISIS in model.has else {}
    return {"the view of a point": lambda: parts.warm_up(model.gear(*AT))} | crises


def everything(name: str) -> Steps:
    """Return what needs any kernel; the process that compiles for others then notes every part of it."""
    steps: Steps = {}
    for part in survey, orbits, curves, attractors, point:
        steps |= part(name)
        compile_apart(part.__module__, part.__name__, name)
    return steps
