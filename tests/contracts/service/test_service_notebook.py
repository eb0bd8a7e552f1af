"""GET /v1/notebook: its cells run, and compute what the service answers and shows of the point."""

import json
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlencode

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest
from fastapi.testclient import TestClient
from service_support import IN_A_THREAD, assert_problem, front_end

import rattle
from gear_rattle.service.operations.diagrams import diagram_span
from rattle import Machine
from rattle.stiff import StiffGear

COARSE = {"starts": 16, "side": 8, "steps": 4, "count": 2}
MACHINE = {"inertia": 0.003, "drag": 0.0005, "backlash": 1e-4, "eccentricity": 1.5e-5, "radius": 0.05, "rpm": 3000.0}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), points=IN_A_THREAD) as client:
        yield client


def cells_of(client: TestClient, **query: Any) -> dict[str, str]:
    """The source of the code cells, by name, of a notebook that has what nbformat 4.5 asks for."""
    answer = client.get(f"/v1/notebook?{urlencode(query)}")
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/x-ipynb+json"
    assert answer.headers["content-disposition"].endswith('.ipynb"')
    found = json.loads(answer.content)
    assert (found["nbformat"], found["nbformat_minor"]) == (4, 5)
    assert found["metadata"]["kernelspec"].keys() >= {"name", "display_name"}
    cells = found["cells"]
    assert len({cell["id"] for cell in cells}) == len(cells)
    for cell in cells:
        also = {"execution_count", "outputs"} if cell["cell_type"] == "code" else set()
        assert cell.keys() == {"id", "cell_type", "metadata", "source"} | also
    assert rattle.__version__ in "".join(cells[0]["source"])
    return {cell["id"]: "".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"}


def executed(cells: dict[str, str]) -> dict[str, Any]:
    """The names that the cells have made, one after the other, with fewer cells and steps."""
    names: dict[str, Any] = {}
    with mpl.rc_context({"backend": "agg"}):
        for name, source in cells.items():
            exec(compile(source, name, "exec"), names)
            if name == "fineness":
                assert names.keys() >= COARSE.keys()
                names |= COARSE
    plt.close("all")
    return names


def test_the_cells_compute_what_is_shown(client: TestClient) -> None:
    gear = rattle.Gear(0.1 + 0.5, 0.1 / 3, 0.6)
    found = executed(cells_of(client, delta=gear.delta, epsilon=gear.epsilon))
    assert found["gear"] == gear  # to the last bit
    asked = client.get(f"/v1/attractors?delta={gear.delta!r}&epsilon={gear.epsilon!r}&count=16").json()["attractors"]
    assert [each.fraction for each in found["attractors"]] == [each["fraction"] for each in asked]
    assert found["basins"].labels.shape == (8, 8)
    low, high = diagram_span(gear, "epsilon")
    assert (found["diagram"].start, found["diagram"].end) == ((gear.delta, low), (gear.delta, high))


@pytest.mark.parametrize(
    ("query", "ends"),
    [
        ({"direction": "delta", "span": 0.01}, ((0.59, 0.03), (0.61, 0.03))),
        ({"to_delta": 0.62, "to_epsilon": 0.04}, ((0.6, 0.03), (0.62, 0.04))),
    ],
)
def test_the_diagram_is_the_one_that_is_shown(client: TestClient, query: dict[str, Any], ends: Any) -> None:
    cells = cells_of(client, delta=0.6, epsilon=0.03, **query)
    found = executed({name: cells[name] for name in ("point", "fineness", "diagram")})
    assert found["diagram"].start == pytest.approx(ends[0])
    assert found["diagram"].end == pytest.approx(ends[1])


def test_the_point_may_be_stiff_or_a_machine(client: TestClient) -> None:
    names: dict[str, Any] = {}
    exec(cells_of(client, delta=0.6, epsilon=0.03, beta=0.5, kappa=1e4)["point"], names)
    assert names["gear"] == StiffGear(0.6, 0.03, 0.5, 1e4)
    exec(cells_of(client, **MACHINE)["point"], names)
    assert names["machine"] == Machine(**MACHINE)
    assert names["gear"] == Machine(**MACHINE).gear


def test_half_an_end_is_refused(client: TestClient) -> None:
    assert_problem(client.get("/v1/notebook?delta=0.6&epsilon=0.1&to_delta=0.7"), 422, "give both")
    assert_problem(client.get("/v1/notebook?delta=0.6&epsilon=0.1&span=0"), 422, "span")
