"""Load or compile kernels now, so that later calls do not pay for it.

What there is to compile is in parts that need nothing of each other, so that processes which share the cache divide
them: each part calls its kernels with nothing to compute.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np

from rattle.attractors.ball import centres_of, enter_balls
from rattle.attractors.chaos import BATCHES, are_chaotic, group_numbers, pooled, standing
from rattle.attractors.classify import ROOM, Classifier, nothing_seen
from rattle.attractors.recurrence import mark_footprints, remember_period_one, resolve
from rattle.attractors.table import Attractors, tabulated
from rattle.flight.first_impact import first_impact, safe_impact
from rattle.flight.lanes.stages import advance
from rattle.impacting.attractors.classifier import ImpactingClassifier, cells_of
from rattle.impacting.attractors.stretch import stretch
from rattle.impacting.gear import Gear
from rattle.impacting.orbits.closed_form import EDGE, closure, fill_nodes, grazing_cosine, next_grazing, nodes
from rattle.impacting.orbits.equations import Itinerary
from rattle.impacting.orbits.period_one import grazing
from rattle.impacting.orbits.stable import stable_cells
from rattle.intensity.balance import impulse_balance_errors
from rattle.intensity.table import Stretch, intensities_of, one_by_one
from rattle.intensity.visit import COLUMNS
from rattle.numerics.compile import can_be_kept, note_in_cache
from rattle.numerics.processes import environment

POINT = 0.6, 0.1, 0.6
CELL = np.array([POINT[0]]), np.array([POINT[1]]), np.array([POINT[2]])
NONE, NOTHING = np.zeros(0, np.int64), np.zeros(0)
NO_ROWS = Attractors(
    *(NONE, NONE, NONE, NONE, NONE, NONE, NOTHING, NOTHING, NOTHING, NOTHING, NOTHING), impacts=NONE, watched=NOTHING
)
OF_INTENSITIES = {"stretches", "intensities"}
HELP = "from rattle.warm import compile_parts; compile_parts({}, intensities={})"

Parts = dict[str, Callable[[], Any]]


def warm_up(kappa: float | None = None) -> None:
    """Run every kernel that a survey needs: compiled in half a minute, or loaded from the disk cache at once.

    Of the impacting gear, or of the stiff one with this stiffness; without boundary distance, basins, Γ, manifolds and
    curves, which compile when first used. Processes that do this at the same time divide the work.
    """
    _compile(kappa, intensities=True)
    _note_compiled(kappa, intensities=True)


def is_compiled(kappa: float | None = None, *, intensities: bool = True) -> bool:
    """Whether what `warm_up` runs, with intensities or without, is in the cache: loaded at once."""
    return _note(kappa, intensities).exists()


def _note(kappa: float | None, intensities: bool) -> Path:
    whose = "impacting" if kappa is None else "stiff"
    return note_in_cache(f"{whose}-survey{'-with-intensities' if intensities else ''}")


def _note_compiled(kappa: float | None, *, intensities: bool) -> None:
    with suppress(OSError):
        _note(kappa, intensities).touch()


def compile_together(kappa: float | None = None, *, intensities: bool = True) -> None:
    """Compile what a survey needs, with intensities or without, unless that was done before; with the help of another
    process if there is a processor for it.
    """
    if is_compiled(kappa, intensities=intensities):
        return
    can_help = can_be_kept() and sys.executable and _processors() > 1
    with _help(kappa, intensities) if can_help else nullcontext():
        _compile(kappa, intensities=intensities)
    _note_compiled(kappa, intensities=intensities)


def _compile(kappa: float | None, *, intensities: bool) -> None:
    compile_parts(kappa, intensities=intensities)
    for work in _parts(kappa, intensities).values():  # also what another process is still at
        work()


def compile_parts(kappa: float | None = None, *, intensities: bool = True) -> None:
    """Compile the parts that no other process is at: from the first on or, if that is taken, from the last."""
    (name, first), *others = _parts(kappa, intensities).items()
    is_free = _unless_elsewhere(name, first)
    for name, work in others if is_free else reversed(others):
        _unless_elsewhere(name, work)


def _unless_elsewhere(name: str, work: Callable[[], Any]) -> bool:
    """Do this part, unless another process is at it."""
    work()
    return True


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _help(kappa: float | None, intensities: bool) -> Iterator[None]:
    """Another process that compiles parts until this ends, when it has none left."""
    nowhere: Any = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    process = subprocess.Popen([sys.executable, "-c", HELP.format(kappa, intensities)], env=environment(), **nowhere)
    try:
        yield
    finally:
        process.kill()
        process.wait()


class _Unknowing(ImpactingClassifier):
    """Of cells of which nothing is known beforehand."""

    def enter_known_orbits(self) -> None:
        pass


def _parts(kappa: float | None, intensities: bool) -> Parts:
    """By name, those with the flights of samples first: what a process has compiled of one, the next ones need."""
    whose, parts = ("impacting", _of_impacting()) if kappa is None else ("stiff", _of_stiff(kappa))
    return {f"{whose} {name}": part for name, part in parts.items() if intensities or name not in OF_INTENSITIES}


def _of_impacting() -> Parts:
    def empty() -> _Unknowing:
        return _Unknowing(cells_of(*CELL), np.zeros((1, 0)), np.zeros((1, 0)))

    def orbits() -> None:
        delta, _, beta = POINT
        Gear(*POINT).orbits()
        grazing("G1", delta, beta)
        # What a curve is traced with; to trace one would load scipy, in workers that trace none.
        nodes(delta, beta)
        next_grazing(EDGE, delta, beta)
        closure(EDGE, delta, beta)
        grazing_cosine(delta, beta)
        Itinerary((1,), 1, beta).residual(np.array([0.0, *POINT[:2]]))

    def known() -> None:
        remember_period_one(*stable_cells(*CELL, ROOM), empty().cells, empty().orbits)

    flights = lambda: None
    classified = _of_classifier(empty, stretch)
    tables = classified.pop("tables")  # the last: who begins there needs no flights meanwhile
    return {"flights": flights} | classified | {"orbits": orbits, "known": known, "tables": tables}


def _of_stiff(kappa: float) -> Parts:
    from rattle.stiff import StiffGear  # not for who has no use for it
    from rattle.stiff.attractors.classifier import StiffClassifier
    from rattle.stiff.attractors.classifier import cells_of as stiff_cells_of
    from rattle.stiff.map.flow import departure, piece

    def empty() -> StiffClassifier:
        return StiffClassifier(stiff_cells_of(*CELL, np.array([kappa])), np.zeros((1, 0)), np.zeros((1, 0)))

    flights = {"flights": (lambda: None)}
    return flights | _of_classifier(empty, one_by_one) | {"orbits": StiffGear(*POINT, kappa).orbits}


def _of_classifier(empty: Callable[[], Classifier], stretched: Stretch) -> Parts:
    """Of a classifier of a cell without samples."""

    def balls() -> None:
        of = empty()
        centres = centres_of(of.grown, of.orbits, of.cells)
        of.enlarge(centres)
        enter_balls(centres, of.balls)

    def samples() -> None:
        of = empty()
        of.advance(NONE, of.samples, early=False)

    def witnesses() -> None:
        empty().watch(NONE, NOTHING, NOTHING, nothing_seen(0))

    def stretches() -> None:
        stretched(NONE, NOTHING, NOTHING, NOTHING, empty().cells)

    def recurrences() -> None:
        of = empty()
        resolve(NONE, of.cells, of.samples, of.orbits, of.balls, of.grown)

    def footprints() -> None:
        of = empty()
        mark_footprints(NONE, 1, of.cells, of.samples, nothing_seen(0).prints)

    def balance() -> None:
        impulse_balance_errors(NO_ROWS, empty().cells)

    def intensities() -> None:
        intensities_of(NO_ROWS, empty().cells, lambda *_: np.zeros((0, BATCHES, COLUMNS)))

    def tables() -> None:
        of, (sums, prints) = empty(), nothing_seen(0)
        standing(NONE, of.samples.status[None], of.samples.impacts[None], of.longer)
        are_chaotic(sums)
        group_numbers(prints, NONE, NONE)
        pooled([sums])
        tabulated(of, missed=True)

    every = balls, recurrences, footprints, balance, intensities, stretches, samples, witnesses, tables
    return {part.__name__: part for part in every}
