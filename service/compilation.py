"""What is computed so that every kernel of a model is compiled, or loaded: one small piece of work for each part."""

from __future__ import annotations

import numpy as np

import rattle
from gear_rattle.service.explorer.point import parts
from gear_rattle.service.kernels import AT, Part, Work, model_for, note_compiled
from gear_rattle.service.operations.points import curves_document, intensities, orbits_document
from rattle.attractors import BUDGET
from rattle.families import joined
from rattle.models import AnyModel, Model


def _orbits(model: AnyModel) -> None:
    orbits_document(model.gear(*AT))


def _curves(model: AnyModel) -> None:
    delta, _ = AT
    curves_document(model, (0.99 * delta, delta), (0.0, 0.2))


def _attractors(model: AnyModel) -> None:
    rattle.warm_up(model.stiffness)
    intensities(model.gear(*AT), 16, None, 0, BUDGET)
    delta, epsilon = np.array(AT[:1]), np.array(AT[1:])
    joined(delta, epsilon, 16, model.attractors_of(delta, epsilon[:, None], 16), model.cells(delta, epsilon))


def _point(model: AnyModel) -> None:
    parts.warm_up(model.gear(*AT))
    if model.has_crisis:
        rattle.crisis_side(*AT)  # surveys of basins ask it, and the estimate of their cost


WORK: Work = {
    Part.ORBITS: _orbits,
    Part.CURVES: _curves,
    Part.ATTRACTORS: _attractors,
    Part.POINT: _point,
}


def compile_all(name: Model) -> None:
    """Compile or load every kernel of a model, in this process."""
    for work in WORK.values():
        work(model_for(name))
    note_compiled(name)
