"""Kernels that are not there yet: requests wait for them or are told so, and nobody's time is counted meanwhile."""

import asyncio
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from depth import deep
from dying import die
from service_support import IN_A_THREAD, assert_problem, front_end, front_of, idle_cluster, local_client, points_in
from waiting import HANG, wait_until

from gear_rattle.service.app import create_app
from gear_rattle.service.kernels import compile_kernels
from gear_rattle.service.settings import Settings
from rattle.models import Impacting, Stiff

POINTS = (
    "/v1/orbits?delta=0.6&epsilon=0.1",
    "/v1/attractors?delta=0.6&epsilon=0.1&count=4",
    "/v1/basins.png?delta=0.6&epsilon=0.1&resolution=10",
    "/v1/curves?delta_min=0.7&delta_max=0.71",
)


class Compilation:
    """Compilations of a service that take until they are let go, and the models that they are of."""

    def __init__(self) -> None:
        self.models: list[str] = []
        self._end: asyncio.Event | None = None

    async def run_sync(self, function: Callable[[str], None], model: str, *, cancellable: bool) -> None:
        """Wait in place of a process that compiles."""
        assert function is compile_kernels
        assert cancellable
        self.models.append(model)
        self._end = asyncio.Event()
        await self._end.wait()

    def let_go(self) -> None:
        """End the compilation that began last; for the event loop of the service."""
        assert self._end is not None
        self._end.set()


@pytest.fixture
def note(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Return the missing file that would say that all kernels are compiled."""
    missing = tmp_path / "kernels.note"
    monkeypatch.setattr("gear_rattle.service.kernels.completion_note_path", lambda _model, _work: missing)
    return missing


@pytest.fixture
def compiling(monkeypatch: pytest.MonkeyPatch, note: Path) -> Compilation:  # noqa: ARG001 - nothing is compiled yet
    """Return a compilation that does not end by itself."""
    compilation = Compilation()
    monkeypatch.setattr("gear_rattle.service.kernels.to_process", compilation)
    return compilation


@pytest.mark.parametrize("path", POINTS)
@pytest.mark.usefixtures("compiling")
def test_a_request_that_waits_too_long_for_kernels_says_so(tmp_path: Path, path: str) -> None:
    with front_end(tmp_path, max_point_seconds=0.05) as client:
        answer = client.get(path)
    assert_problem(answer, 503, code="compiling_kernels")
    assert answer.headers["retry-after"]


def test_seconds_of_a_limit_count_computing_only(tmp_path: Path, compiling: Compilation) -> None:
    """A request waits for kernels, and computes for as long as the limit says from when they are there."""
    app = create_app(Settings(data=tmp_path, max_points=1, max_point_seconds=HANG), idle_cluster)
    with points_in(IN_A_THREAD), local_client(app) as client, ThreadPoolExecutor() as threads:
        asked = [threads.submit(client.get, path) for path in POINTS]
        wait_until(lambda: front_of(client).kernels.waiting == len(POINTS))
        health, ready = client.get("/v1/health").json(), client.get("/v1/ready")
        client.portal.call(compiling.let_go)
        assert health["status"] == "warming"
        assert_problem(ready, 503, code="compiling_kernels")
        assert [each.result(HANG).status_code for each in asked] == [200] * len(POINTS)


def test_only_so_many_wait_for_kernels(tmp_path: Path, compiling: Compilation) -> None:
    limits = {"max_points_waiting": 1, "max_point_seconds": HANG}
    with front_end(tmp_path, points=IN_A_THREAD, **limits) as client, ThreadPoolExecutor() as threads:
        first = threads.submit(client.get, POINTS[0])
        wait_until(lambda: front_of(client).kernels.waiting)
        second = client.get(POINTS[1])
        client.portal.call(compiling.let_go)
        assert_problem(second, 503, code="compiling_kernels")
        assert first.result(HANG).status_code == 200


def test_kernels_of_the_stiff_model_wait_for_who_asks(tmp_path: Path, compiling: Compilation) -> None:
    with front_end(tmp_path, max_point_seconds=0.05) as client:
        client.portal.call(front_of(client).kernels.start_compiling)
        wait_until(lambda: compiling.models)
        assert compiling.models == [Impacting.name]
        assert_problem(client.get(f"{POINTS[0]}&kappa=1e4"), 503, code="compiling_kernels")
        assert compiling.models == [Impacting.name, Stiff.name]


def test_ready_says_when_surveys_and_points_can_be_computed(tmp_path: Path, compiling: Compilation) -> None:
    """Other tests check which kernels are compiled."""
    with local_client(create_app(Settings(data=tmp_path), idle_cluster)) as client:
        client.portal.call(front_of(client).kernels.start_compiling)
        wait_until(lambda: compiling.models)
        client.portal.call(compiling.let_go)
        wait_until(lambda: client.get("/v1/ready").status_code == 200)
        assert client.get("/v1/ready").json() == {"status": "ready"}
        assert client.get("/v1/health").json()["status"] == "ok"
        front_of(client).manager.storage_state = "unavailable: full"
        assert_problem(client.get("/v1/ready"), 503, code="unavailable")
    assert compiling.models == [Impacting.name]


@pytest.mark.usefixtures("compiling")
def test_a_service_ends_while_it_compiles(tmp_path: Path) -> None:
    with front_end(tmp_path) as client:
        kernels = front_of(client).kernels
        client.portal.call(kernels.start_compiling)
        assert kernels.is_compiling
    assert not kernels.is_compiling


@pytest.mark.usefixtures("note")
def test_a_process_that_dies_of_compiling_is_no_hang(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Requests compile what they need then."""
    monkeypatch.setattr("gear_rattle.service.kernels.compile_kernels", die)
    with front_end(tmp_path, max_point_seconds=HANG) as client:
        assert client.get(POINTS[0]).status_code == 200
        wait_until(lambda: front_of(client).kernels.is_compiled(Impacting.name))


def test_what_another_process_has_compiled_is_not_waited_for(
    tmp_path: Path, compiling: Compilation, note: Path
) -> None:
    note.touch()
    with front_end(tmp_path, points=IN_A_THREAD, max_point_seconds=HANG) as client:
        assert client.get(POINTS[0]).status_code == 200
        assert not compiling.models
        assert not front_of(client).kernels.is_compiling


EVERYTHING = """
import logging
import sys

import numpy as np

from rattle import RattleError
from rattle.families.join import join_attractors
from rattle.models import MODELS, Capability
from rattle.attractors import SampleSpec
from gear_rattle.service.operations.estimate import measure_cell_seconds
from gear_rattle.service.explorer.point import parts as point_parts
from gear_rattle.service.kernels import compile_kernels
from gear_rattle.service.routes.model.basin_picture import _draw_basins
from gear_rattle.service.operations import diagrams
from gear_rattle.service.operations.points import compute_intensities, curves_document, orbits_document
from gear_rattle.workers import SurveyRequest, compute_tile, tiles_of
from gear_rattle.workers.survey.template import template_of

name = sys.argv[1]
compile_kernels(name)
needed = []


class Needed(logging.Handler):
    def emit(self, record):
        needed.append(record.getMessage())


log = logging.getLogger("rattle.numerics.compile")
log.setLevel(logging.INFO)
log.addHandler(Needed())
added = {each.name: each.example for each in MODELS[name].added}
for delta, epsilon, beta in ((0.5, 0.25, 0.6), (1.5, 0.4, 0.3))[: 1 if added else 2]:
    model = MODELS[name](beta, **added)
    gear = model.gear(delta, epsilon)
    orbits_document(gear)
    compute_intensities(gear, 16, None, 0, 100_000)
    point_parts.sampled_attractors(gear, 16)
    for method in ("cells", "refined", "direct"):
        point_parts.compute_basins(gear, 20, method)
    point_parts.motion_from_state(gear, 0.3, 4.0, 1.0, 2)
    point_parts.compute_plane_lines(gear)
    if Capability.MARGIN in model.has:
        point_parts.compute_quiet_margin(gear)
    for direction in diagrams.SPANS:
        point_parts.compute_diagram_contents(gear, direction, steps=4, count=4)
    _draw_basins(gear, 10, (0.0, 1.0), (0.0, 7.0))
    curves_document(model, (0.98 * delta, delta), (0.0, 0.3))
fields = {"model": name, **added}
groups = ["region", "orbits", "attractors", "lyapunov", "basins", "intensity", *([] if added else ["grazing"])]
axes = {"delta": {"start": 0.5, "stop": 0.6, "num": 2}, "epsilon": {"start": 0.05, "stop": 0.1, "num": 2}}
measure_cell_seconds(SurveyRequest(**axes, initial_conditions={"count": 4}, quantities=groups, **fields))
usual = SurveyRequest(**axes, initial_conditions={"count": 4}, **fields)
template_of(usual)
compute_tile(usual, tiles_of(usual)[0])
delta, epsilon = np.linspace(0.35, 0.4, 3), np.linspace(0.2, 0.3, 3)
found = model.attractors_of(delta, epsilon[:, None], SampleSpec(16))
join_attractors(delta, epsilon, 16, found, model.cells(delta, epsilon))
print("needed:", needed)
"""


@pytest.mark.parametrize("model", [Impacting.name, pytest.param(Stiff.name, marks=deep)])
def test_what_is_made_ready_is_all_that_a_point_or_a_survey_needs(model: str) -> None:
    """Elsewhere in the plane nothing further is compiled."""
    command = [sys.executable, "-c", EVERYTHING, model]
    said = subprocess.run(command, check=True, capture_output=True, text=True, timeout=HANG).stdout
    assert said.splitlines()[-1] == "needed: []"
