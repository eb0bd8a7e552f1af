"""What is computed so that every kernel that the service needs of a model is compiled: small pieces of its work."""

from __future__ import annotations

import numpy as np

import rattle
from gear_rattle.service.explorer.point import parts
from gear_rattle.service.operations.points import curves_document, intensities, orbits_document
from rattle.attractors import BUDGET
from rattle.families import joined
from rattle.models import AnyModel, Model, model_of
from rattle.numerics import compile_apart
from rattle.precompile import BETA, KAPPA, Steps, survey

AT = 0.6, 0.1  # δ, ε of the gear that is computed for its kernels


def orbits(name: str) -> Steps:
    """Return what needs the kernels of period-one motions and limits."""
    return {"closed forms": lambda: orbits_document(_model(name).gear(*AT))}


def curves(name: str) -> Steps:
    """Return what needs the kernels of curves."""
    delta, _ = AT
    return {"curves": lambda: curves_document(_model(name), (0.99 * delta, delta), (0.0, 0.2))}


def attractors(name: str) -> Steps:
    """Return what needs the kernels of attractors, beside those of a survey."""
    model = _model(name)

    def attractors_at() -> None:
        intensities(model.gear(*AT), 16, None, 0, BUDGET)
        delta, epsilon = np.array(AT[:1]), np.array(AT[1:])
        joined(delta, epsilon, 16, model.attractors_of(delta, epsilon[:, None], 16), model.cells(delta, epsilon))

    return {"attractors of a point": attractors_at}


def point(name: str) -> Steps:
    """Return what needs the kernels of the view of a point, and of the estimate of a survey with basins."""
    model = _model(name)
    crises: Steps = {"crises": lambda: rattle.crisis_side(*AT)} if model.has_crisis else {}
    return {"the view of a point": lambda: parts.warm_up(model.gear(*AT))} | crises


def everything(name: str) -> Steps:
    """Return what needs any kernel; the process that compiles for others then notes every part of it."""
    steps: Steps = {}
    for part in survey, orbits, curves, attractors, point:
        steps |= part(name)
        compile_apart(part.__module__, part.__name__, name)
    return steps


def _model(name: str) -> AnyModel:
    return model_of(BETA, KAPPA if name == Model.STIFF else None)
