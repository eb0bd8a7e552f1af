"""What is computed so that every kernel that the service needs of a model is compiled: small pieces of its work."""

from __future__ import annotations

import numpy as np

import rattle
from gear_rattle.service.operations.points import curves_document, intensities, orbits_document
from rattle.attractors.classify import BUDGET
from rattle.families.join import joined
from rattle.models import AnyModel, Model, model_of
from rattle.numerics.compile import compile_apart, note_of
from rattle.precompile import BETA, KAPPA, Steps

AT = 0.6, 0.1  # δ, ε of the gear that is computed for its kernels
SURVEY, SERVICE = ("rattle.precompile", "survey"), (__name__, "service")


def compile_all(name: Model) -> None:
    """Compile every kernel of a model in processes of their own: first those that workers wait for. Raises RattleError."""
    for module, work in (SURVEY, SERVICE):
        compile_apart(module, work, name)


def is_compiled(name: Model) -> bool:
    """Return whether every kernel of a model is in the cache; to find that out by loading them takes seconds."""
    return all(note_of(work, name).exists() for _, work in (SURVEY, SERVICE))


def load(name: Model) -> None:
    """Load the kernels that routes and pages use in the service's own process."""
    model = _model(name)
    _orbits(model)
    _curves(model)


def service(name: str) -> Steps:
    """Return the work that needs the kernels of a model, by name."""
    from gear_rattle.service.explorer.point import parts

    model = _model(name)
    gear = model.gear(*AT)

    def attractors() -> None:
        intensities(gear, 16, None, 0, BUDGET)
        delta, epsilon = np.array(AT[:1]), np.array(AT[1:])
        joined(delta, epsilon, 16, model.attractors_of(delta, epsilon[:, None], 16), model.cells(delta, epsilon))

    def points() -> None:
        parts.warm_up(gear)
        if model.has_crisis:
            rattle.crisis_side(*AT)  # surveys of basins need it, and the estimate of their cost

    return {
        "closed forms": lambda: _orbits(model),
        "curves": lambda: _curves(model),
        "attractors": attractors,
        "points": points,
    }


def _model(name: str) -> AnyModel:
    return model_of(BETA, KAPPA if name == Model.STIFF else None)


def _orbits(model: AnyModel) -> None:
    orbits_document(model.gear(*AT))


def _curves(model: AnyModel) -> None:
    delta, _ = AT
    curves_document(model, (0.99 * delta, delta), (0.0, 0.2))
