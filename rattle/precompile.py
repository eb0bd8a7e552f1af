"""Compile kernels in advance, by running small examples of the work that needs them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.chaos import pool_exponents, write_attractor_numbers
from rattle.attractors.classify import allocate_probe_record
from rattle.attractors.recurrence import assign_orbits_to_recurrent_samples, mark_states_in_bitmaps
from rattle.attractors.speeds import SampleSpec
from rattle.families.join import join_attractors
from rattle.impacting.orbits.period_one import grazing
from rattle.models import BETA, MODELS, Capability, Model, model_with_parameters
from rattle.numerics.compile import compile_in_subprocess

DELTA, EPSILON = 0.6, 0.1
HIGHEST = 0.25  # upper end in ε of the window in which an example of a bifurcation curve is traced
COUNT = 16  # number of samples of an example cell
SURVEY, OPTIONAL_QUANTITIES = f"{__name__}:kernel_steps_for_surveys", f"{__name__}:optional_quantity_steps"
Steps = dict[str, Callable[[], object]]


def precompile(*, preload: bool = False, optional: bool = False, **added: float | None) -> None:
    """Compile the kernels of surveys, unless they are in the cache.

    A separate process compiles them, once for all processes of a machine, in up to a minute. Kernels that no survey
    needs, such as those of the boundary distance or of manifolds, are compiled on first use.

    Parameters
    ----------
    preload : bool
        Whether to load also the kernels that follow samples, so that the first tile need not load them.
    optional : bool
        Whether to compile also the kernels of families and intensities, which only some surveys need.
    **added : float, optional
        Further parameters of a model, such as the stiffness of the stiff gear. Their names select the model whose
        kernels are compiled; without them it is the impacting gear.

    Raises
    ------
    ParameterError
        If no model has the given parameters.
    RattleError
        If the kernels cannot be compiled; the message says why.
    """
    model = model_with_parameters(name for name, value in added.items() if value is not None).name
    compile_in_subprocess(model, SURVEY, *([OPTIONAL_QUANTITIES] if optional else []))
    if preload:
        kernel_steps_for_surveys(model)["attractors"]()


def example_model(name: str) -> Model:
    """Return the model of this name, with the example parameters at which its kernels are run to compile them."""
    return MODELS[name](BETA.example, **{each.name: each.example for each in MODELS[name].added})


def kernel_steps_for_surveys(name: str) -> Steps:
    """Return {step: function} for the model `name`: the functions run, and so compile, the kernels of every survey."""
    model, delta, epsilon, few = _example_cells(name)

    def compile_orbits() -> None:
        model.period_one(delta, epsilon)
        model.gear(DELTA, EPSILON).orbits()
        if Capability.CORNERS in model.has:
            grazing("G2", DELTA, BETA.example)
            model.trace("G1", (0.99 * DELTA, DELTA), (0.0, HIGHEST))

    def compile_attractors() -> None:
        table = model.attractors_of(delta, epsilon, few)
        if Capability.BALANCE in model.has:
            model.impulse_balance_errors(delta, epsilon, table)

    def compile_rare_cases() -> None:
        # the samples of the example cells may not need the kernels below, so these are called with empty arrays
        none, nothing, seen = np.zeros(0, np.int64), np.zeros(0), allocate_probe_record(0)
        states = np.zeros((delta.size, 1)), np.full((delta.size, 1), 5.0)
        of = model.classify_states(model.parameters_at(delta, epsilon), *states)
        assign_orbits_to_recurrent_samples(
            none, of.cells, of.samples, of.orbits, of.balls, of.n_orbits_with_capture_regions
        )
        mark_states_in_bitmaps(none, 1, of.cells, of.samples, seen.bitmaps)
        write_attractor_numbers(seen.bitmaps, none, none)
        of.follow_with_tangent(none, nothing, nothing, seen)
        pool_exponents([seen.sums])

    first: Steps = {"orbits": compile_orbits} if Capability.PERIOD_ONE in model.has else {}
    return first | {"attractors": compile_attractors, "rare cases": compile_rare_cases}


def optional_quantity_steps(name: str) -> Steps:
    """Return {quantity: function} for the model `name`: each function runs, and so compiles, the quantity's kernels."""
    model, delta, epsilon, few = _example_cells(name)

    def compile_families() -> None:
        table = model.attractors_of(delta[:1], epsilon[:, None], few)
        join_attractors(delta[:1], epsilon, COUNT, table, model.cells(delta, epsilon))

    def compile_intensities() -> None:
        model.intensities_of(delta, epsilon, model.attractors_of(delta, epsilon, few))

    more: Steps = {"intensities": compile_intensities} if Capability.INTENSITY in model.has else {}
    return {"families": compile_families, **more}


def _example_cells(name: str) -> tuple[Model, NDArray[np.float64], NDArray[np.float64], SampleSpec]:
    """Return the model of this name, δ (n,) and ε (n,) of the example cells, and the specification of their samples."""
    model = example_model(name)
    epsilon = np.array(model.precompilation_epsilons)
    return model, np.full(epsilon.size, DELTA), epsilon, SampleSpec(COUNT)
