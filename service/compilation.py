"""Compile the kernels that requests to a service need, by computing small examples with a model."""

from __future__ import annotations

import numpy as np

import rattle
from gear_rattle.service.explorer.point import parts
from gear_rattle.service.operations.points import compute_intensities, curves_document, orbits_document
from rattle.attractors import BUDGET, SampleSpec
from rattle.families import join_attractors
from rattle.models import Capability
from rattle.precompile import Steps, example_model

EXAMPLE_POINT = 0.6, 0.1  # δ, ε of the computed example


def compilation_steps_for_answers(name: str) -> Steps:
    """Return functions that compile those kernels of the model `name` that requests about a point or a curve need.

    The kernels of surveys are compiled by other functions.

    Returns
    -------
    Steps
        {name of a step: function without arguments that compiles kernels by computing an example}.
    """
    model, (delta, epsilon) = example_model(name), EXAMPLE_POINT
    gear = model.gear(delta, epsilon)

    def compute_attractors() -> None:
        compute_intensities(gear, 16, None, 0, BUDGET)
        deltas, epsilons = np.array([delta]), np.array([epsilon])
        table = model.attractors_of(deltas, epsilons[:, None], SampleSpec(16))
        join_attractors(deltas, epsilons, 16, table, model.cells(deltas, epsilons))

    crises: Steps = {"crises": lambda: rattle.crisis_side(*EXAMPLE_POINT)} if Capability.CRISIS in model.has else {}
    return {
        "closed forms": lambda: orbits_document(gear),
        "curves": lambda: curves_document(model, (0.99 * delta, delta), (0.0, 0.2)),
        "attractors of a point": compute_attractors,
        "the view of a point": lambda: parts.load_point_kernels(gear),
    } | crises
