"""docs/map.md is true: its picture is of today's imports, it names every room, and its recipes do what they promise."""

import ast
import re
import runpy
import shutil
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Any

import grimp
import pytest
from depth import deep
from waiting import HANG

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "map.md").read_text()
PACKAGES = ("rattle", "workers", "service")
STEP = re.compile(
    r"New file `(?P<new>[^`]+)`:\n\n```(?:python|toml)\n(?P<file>.*?)```"
    r"|In `(?P<at>[^`]+)`, before `(?P<line>[^`]+)`:\n\n```\n(?P<code>.*?)```"
    r"|In `(?P<in>[^`]+)`, replace `(?P<old>[^`]+)` by `(?P<by>[^`]+)`",
    re.S,
)
PROMISES = {
    "quantity": """
import sys
from gear_rattle.workers import SurveyRequest, compute_tile, tiles_of
from gear_rattle.workers.survey.template import template_of
request = SurveyRequest(
    delta={"start": 0.6, "stop": 0.7, "num": 2}, epsilon={"start": 0.1, "stop": 0.2, "num": 2}, quantities=["orbits"]
)
arrays, _ = compute_tile(request, tiles_of(request)[0])
assert (arrays["orbit_count"] == arrays["orbit_exists"].sum(axis=0)).all()
assert arrays["orbit_count"].max() == 4
assert "orbit_count/zarr.json" in template_of(request)
sys.path += ["tests/contracts/workers", *TESTS]
from test_workers_registry import SCHEMA, test_the_registry_is_the_schema
test_the_registry_is_the_schema()
assert "orbit_count" in SCHEMA
""",
    "curve": """
import rattle
from rattle.plot.plane import plane_figure
from gear_rattle.service.explorer.map.overlays import legend_entries_of_map
from rattle.models import Impacting
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.survey.template import template_of
curve = rattle.curves.trace("PDC_low", 0.6, (0.4, 0.6), (0.0, 0.3))
assert 0.49 < curve.delta.max() <= 0.5 + 1e-9
assert abs(curve.epsilon - [rattle.flip(delta) for delta in curve.delta]).max() < 1e-9
assert "the flip of C at low damping" in str(legend_entries_of_map(Impacting()))
texts = plane_figure((0.4, 0.9), (0.005, 0.3)).figure.findobj(lambda artist: hasattr(artist, "get_text"))
assert "PDC_low" in {text.get_text().replace(" ", "_") for text in texts}
request = SurveyRequest(
    delta={"start": 0.5, "stop": 0.7, "num": 2}, epsilon={"start": 0.1, "stop": 0.2, "num": 2}, quantities=["region"]
)
assert any(key.startswith("curves/PDC_low/") for key in template_of(request))
""",
    "gear": """
import asyncio
import sys
import tempfile
from math import pi
from pathlib import Path
import rattle
import xarray as xr
sys.path += TESTS
from service_support import BODY, IN_A_THREAD, compute, front_end, front_of, no_cluster
from waiting import HANG, eventually
from gear_rattle.service.app import create_app
from gear_rattle.service.commands.survey_options import OPTIONS, request_from_options
from gear_rattle.service.explorer.common.address import View, create_pin
from gear_rattle.service.explorer.places.example import REQUEST
from gear_rattle.service.explorer.point import parts
from gear_rattle.service.explorer.point.panel import PointPanel
from gear_rattle.service.explorer.point.view import PointView
from gear_rattle.service.explorer.state.store import PageStore
from gear_rattle.service.settings import Settings
from gear_rattle.workers import SurveyRequest
from rattle.models import MODELS, model_of

model = model_of(0.6, wear=0.5)
assert model.name == "worn"
assert abs(model.gear(0.4, 0.1).quiet_limit - rattle.quiet_limit(0.6)) < 1e-15
given = BODY | {"model": "worn", "wear": 0.5, "delta": {"start": 0.4, "stop": 0.5, "num": 2}, "tile": {}}
data = Path(tempfile.mkdtemp())
with front_end(data, points=IN_A_THREAD) as client:
    refused = client.post("/v1/surveys", json=BODY | {"model": "worn"})
    assert refused.status_code == 422 and "needs wear, the wear of the bearings" in refused.text, refused.text
    refused = client.post("/v1/surveys", json=given | {"quantities": ["grazing"]})
    assert refused.status_code == 422 and "has no grazing" in refused.text, refused.text
    made = client.post("/v1/surveys", json=given)
    assert made.status_code == 202, made.text
    survey = client.get(made.headers["location"]).json()
    assert (survey["request"]["model"], survey["request"]["wear"]) == ("worn", 0.5)
    assert survey["request"]["kappa"] is None
    request = SurveyRequest(**survey["request"])
    compute(front_of(client), survey["id"], request)
    store = xr.open_zarr(front_of(client).directory.store(survey["id"]))
    assert (store.attrs["model"], float(store.wear), store.wear.attrs["long_name"]) == ("worn", 0.5, "wear w")
    assert (store.region.sel(delta=0.4) == rattle.regions(0.6, store.epsilon.values)).all()
    assert float(store.impulse_balance_error.max()) < 0.1
    picture = client.get(f"/v1/surveys/{survey['id']}/map.png", params={"variable": "quiet_fraction"})
    assert picture.content.startswith(b"\\x89PNG"), picture.text
    at = {"delta": 0.4, "epsilon": 0.1, "wear": 0.5}
    found = client.get("/v1/attractors", params=at | {"count": 256}).json()
    assert (found["wear"], found["kappa"]) == (0.5, None)
    speeds = [each["v"] for each in found["attractors"] if (each["m"], each["n_plus"], each["n_minus"]) == (1, 1, 0)]
    assert [abs(v - 2 * pi * 0.6) < 1e-9 for v in speeds] == [True]  # the impulses balance the drag of worn bearings
    assert client.get("/v1/orbits", params=at).json()["region_name"] == "IV"
    assert client.get("/v1/basins.png", params=at | {"resolution": 10}).content.startswith(b"\\x89PNG")
    asked = {"delta": 0.4, "of": "epsilon", "wear": 0.5, "count": 64, "share": 0.8}
    assert client.get("/v1/limits", params=asked).status_code == 200
    assert client.get("/v1/curves", params={"wear": 0.5}).json()["curves"] == []
assert "wear" in OPTIONS
options = {"delta": "0.4:0.5:2", "epsilon": "0.1:0.2:2", "wear": "0.1:0.5:3"}
assert (request_from_options(options).model, request_from_options(options).third_axis_name) == ("worn", "wear")
pin = create_pin(0.4, 0.1, model)
assert "wear" in View(pins=(pin,)).query() and pin.model == model


async def shown():
    app = create_app(Settings(data=data, max_point_seconds=HANG, explorer=False), no_cluster)
    async with app.router.lifespan_context(app):
        store = PageStore(View(point=(0.4, 0.1)), REQUEST)
        view = PointView(PointPanel("light", store.dispatch), app.state.front, store, 0.4, 0.1, model)

        async def here(work, *arguments, **_):
            few = {parts.compute_basins: (40, "cells"), parts.sampled_attractors: (64,)}
            return work(arguments[0], *few[work]) if work in few else work(*arguments)

        view.work.compute = here
        assert "bearings of wear w = 0.5" in view.panel.parameters_text.html
        await eventually(lambda: "quiet" in view.panel.likelihood_text.html and "only" in view.panel.margin_text.html)
        assert "only for the impacting model, not of the worn one" in view.panel.margin_text.html
        view.stop()


asyncio.run(shown())
""",
    "route": """
import sys
import tempfile
from pathlib import Path
from fastapi.testclient import TestClient
from gear_rattle.service.app import create_app
from gear_rattle.service.settings import Settings
app = create_app(Settings(data=Path(tempfile.mkdtemp()), explorer=False))
assert "/v1/balance" in app.openapi()["paths"]
here = TestClient(app, "http://127.0.0.1:8000", client=("127.0.0.1", 50000))
answer = here.get("/v1/balance", params={"delta": 0.5})
assert abs(answer.json()["speed"] - 3.141592653589793) < 1e-12, answer.text
assert here.get("/v1/balance", params={"delta": -1}).status_code == 422
guarded = TestClient(
    create_app(Settings(data=Path(tempfile.mkdtemp()), explorer=False, host="0.0.0.0")), client=("192.0.2.1", 50000)
)
with guarded:
    assert guarded.get("/v1/balance", params={"delta": 0.5}).status_code == 401
""",
}


def test_no_module_is_imported_in_a_circle() -> None:
    """Imports for types and inside functions count, too."""
    graph = grimp.build_graph("rattle", "gear_rattle", cache_dir=None)
    TopologicalSorter({each: graph.find_modules_directly_imported_by(each) for each in graph.modules}).prepare()


def test_models_compile_nothing_of_their_own() -> None:
    """Adding a model must not make kernels compile anew: `COMPILE_NOTHING`."""
    kernels = re.compile(r"numerics\.compile import|numba")
    assert not [path for path in (ROOT / "rattle" / "models").rglob("*.py") if kernels.search(path.read_text())]


def test_nobody_asks_which_gear_it_is() -> None:
    """Differences between gears are methods, or capabilities that the model names."""
    kinds = "Gear|StiffGear|Impacting|Stiff|Itinerary|StiffItinerary"
    asks = re.compile(rf"isinstance\([^()]*\b({kinds})\b")
    own = {"rattle/models", "rattle/impacting", "rattle/stiff"}
    asking = {
        str(path.relative_to(ROOT))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if asks.search(path.read_text()) and not str(path.relative_to(ROOT)).startswith(tuple(own))
    }
    assert not asking


def test_a_room_holds_a_dozen_files_at_most() -> None:
    """But one with a file for each command, or for each part of the paper."""
    rooms = [path for package in PACKAGES for path in (ROOT / package).rglob("*/") if path.name != "__pycache__"]
    files = {
        str(room.relative_to(ROOT)): len([*room.glob("*.py")]) - (room / "__init__.py").is_file() for room in rooms
    }
    crowded = {room for room, count in files.items() if count > 12}
    assert crowded <= {"service/commands", "rattle/paper"}


def test_the_explorer_asks_the_operations_and_never_the_database() -> None:
    """It has the same answers as REST. What it takes of the database's room are the types of rows."""
    reading = {
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in (ROOT / "service/explorer").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if (isinstance(node, ast.Attribute) and node.attr == "database")
        or (isinstance(node, ast.ImportFrom) and re.search(r"service\.database(?!\.tables)", node.module or ""))
    }
    assert not reading


@pytest.fixture(scope="module")
def drawing() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "docs" / "draw_map.py"))


def test_the_picture_is_of_the_imports_of_today(drawing: dict[str, Any]) -> None:
    assert drawing["drawn"]() == drawing["facts"](), "make map"


@pytest.mark.parametrize("package", PACKAGES)
def test_every_room_is_named(package: str, drawing: dict[str, Any]) -> None:
    (section,) = re.findall(rf"## `{package}`.*?(?=\n## )", TEXT, re.S)
    named = set(re.findall(r"`(\w+)`", section))
    rooms = {room for layer in drawing["layers_of"](package) for room in layer}
    assert rooms - named <= {"_version", "errors"}


#: What each recipe adds, and another name for it: whoever has followed one has the first already.
ADDED = {
    "quantity": ("orbit_count", "number_of_orbits"),
    "curve": ("PDC_low", "PDC_beside"),
    "route": ("balance", "balance_of_impulses"),
    "gear": ("worn", "worse"),
}


def steps_of(what: str, name: str) -> list[re.Match[str]]:
    """The steps of a recipe under this name."""
    (recipe,) = re.findall(rf"### To add a {what}\n.*?(?=\n### )", TEXT, re.S)
    steps = list(STEP.finditer(recipe.replace(ADDED[what][0], name)))
    assert steps
    return steps


def followed(what: str, name: str, root: Path) -> None:
    """Copy the code, and carry out a recipe there under this name."""
    for package in (*PACKAGES, "gear_rattle", "tests/contracts"):
        shutil.copytree(
            ROOT / package, root / package, ignore=shutil.ignore_patterns("__pycache__", "documents"), symlinks=True
        )
    for step in steps_of(what, name):
        carry_out(step, root)


def is_free(what: str, name: str) -> bool:
    """Return whether nobody has followed the recipe here under this name."""
    step = steps_of(what, name)[0]
    return not (ROOT / step["new"]).exists() if step["new"] else step["code"] not in (ROOT / step["at"]).read_text()


@pytest.mark.parametrize("what", [pytest.param(what, marks=() if what == "quantity" else deep) for what in PROMISES])
def test_a_recipe_does_what_it_promises(what: str, tmp_path: Path) -> None:
    """Under its own name, or under another one where it was followed already."""
    own, other = ADDED[what]
    name = own if is_free(what, own) else other
    followed(what, name, tmp_path)
    shared = [str(ROOT / "tests"), str(ROOT / "tests" / "contracts")]
    promise = f"TESTS = {shared!r}\n" + PROMISES[what].replace(own, name)
    done = subprocess.run([sys.executable, "-c", promise], cwd=tmp_path, capture_output=True, text=True, timeout=HANG)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("what", PROMISES)
@pytest.mark.parametrize("which", [0, 1], ids=["verbatim", "another name"])
def test_what_a_recipe_adds_is_as_the_linters_want_it(what: str, which: int, tmp_path: Path) -> None:
    name = ADDED[what][which]
    if not is_free(what, name):
        pytest.skip("followed here already")
    followed(what, name, tmp_path)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for check in (["check"], ["format", "--check"]):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *check, "--no-cache", "."],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=HANG,
        )
        assert done.returncode == 0, done.stdout


def carry_out(step: re.Match[str], root: Path) -> None:
    if step["new"]:
        (root / step["new"]).parent.mkdir(parents=True, exist_ok=True)
        (root / step["new"]).write_text(step["file"])
        return
    path = root / (step["at"] or step["in"])
    before, old = path.read_text(), step["line"] or step["old"]
    assert before.count(old) == 1, old
    path.write_text(before.replace(old, step["code"] + old if step["code"] else step["by"]))
