"""Compile kernels before anybody's time is counted, by small pieces of the work that needs them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rattle.attractors.chaos import group_numbers, pooled
from rattle.attractors.classify import nothing_seen
from rattle.attractors.recurrence import mark_footprints, resolve
from rattle.families.join import joined
from rattle.impacting.orbits.period_one import grazing
from rattle.models import Model, model_of
from rattle.numerics.compile import compile_apart

BETA, KAPPA = 0.6, 1e4
DELTA = 0.6
QUIET, CHAOS_TOO, CHAOS = 0.089, 0.1, 0.25  # ε: quiet motion beside impacts, beside chaos too, chaos alone
COUNT = 16  # samples of a cell
Steps = dict[str, Callable[[], object]]


def precompile(kappa: float | None = None, *, load: bool = False) -> None:
    """Compile the kernels of surveys, unless that was done before.

    They are compiled in a process of their own, once on a machine for all processes, in up to a minute. Those that no
    survey needs, such as of the boundary distance or of manifolds, are compiled when first used.

    Parameters
    ----------
    kappa : float, optional
        Stiffness, for kernels of the stiff gear; by default those of the impacting gear.
    load : bool
        Whether to load those that follow samples too, so that the first tile need not.

    Raises
    ------
    RattleError
        The kernels cannot be compiled; the message says why.
    """
    model = model_of(BETA, kappa).name
    compile_apart(__name__, "survey", model)
    if load:
        survey(model)["attractors"]()


def survey(name: str) -> Steps:
    """Return what needs the kernels of a survey of this model."""
    model = model_of(BETA, KAPPA if name == Model.STIFF else None)
    epsilon = np.array([QUIET, CHAOS_TOO, CHAOS] if model.in_closed_form else [CHAOS_TOO])  # the other takes longer
    delta = np.full(epsilon.size, DELTA)

    def orbits() -> None:
        model.period_one(delta, epsilon)
        model.gear(DELTA, CHAOS_TOO).orbits()
        if model.in_closed_form:
            grazing("G2", DELTA, BETA)
            model.trace("G1", (0.99 * DELTA, DELTA), (0.0, CHAOS))

    def attractors() -> None:
        table = model.attractors_of(delta, epsilon, COUNT)
        model.impulse_balance_errors(delta, epsilon, table)

    def rare() -> None:  # what only some samples need
        beta, kappa = np.full(delta.size, BETA), np.full(delta.size, KAPPA)
        columns = (delta, epsilon, beta) if model.in_closed_form else (delta, epsilon, beta, kappa)
        none, nothing, seen = np.zeros(0, np.int64), np.zeros(0), nothing_seen(0)
        of = model.classified(columns, np.zeros((delta.size, 1)), np.full((delta.size, 1), 5.0))
        resolve(none, of.cells, of.samples, of.orbits, of.balls, of.grown)
        mark_footprints(none, 1, of.cells, of.samples, seen.prints)
        group_numbers(seen.prints, none, none)
        of.watch(none, nothing, nothing, seen)
        pooled([seen.sums])

    def intensities() -> None:
        model.intensities_of(delta, epsilon, model.attractors_of(delta, epsilon, COUNT))

    def families() -> None:
        table = model.attractors_of(delta[:1], epsilon[:, None], COUNT)
        joined(delta[:1], epsilon, COUNT, table, model.cells(delta, epsilon))

    return {
        "orbits": orbits,
        "attractors": attractors,
        "rare cases": rare,
        "intensities": intensities,
        "families": families,
    }
