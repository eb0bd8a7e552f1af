"""schemathesis over the whole OpenAPI document, and every example of it executed."""

import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import httpx
import jsonschema_rs
import pytest
import uvicorn
from depth import DEEP, deep, either
from fastapi import FastAPI
from service_support import BODY, IN_A_THREAD, idle_cluster, points_in
from typer.testing import CliRunner
from waiting import HANG, wait_until
from written import write_tile

from gear_rattle.service.access.keys import add_key
from gear_rattle.service.app import create_app
from gear_rattle.service.cli import app as cli
from gear_rattle.service.client import Client
from gear_rattle.service.database.tables import JobKind, Scope, State
from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.jobs import manager
from gear_rattle.service.operations import estimate, windows
from gear_rattle.service.operations.crises import CrisisCurves
from gear_rattle.service.operations.design_limits import DesignLimits
from gear_rattle.service.operations.points import compute_intensities, curves_document, orbits_document
from gear_rattle.service.routes import download, limits
from gear_rattle.service.routes.model import basin_picture, intensity, plane_curves, points, reached, verdict
from gear_rattle.service.settings import Settings
from gear_rattle.service.web import examples
from gear_rattle.workers import (
    SurveyError,
    SurveyRequest,
    compute_tile,
    create_store,
    finish_store,
    open_survey,
    parse_request_document,
    tiles_of,
)
from gear_rattle.workers.certificates import certify_survey
from gear_rattle.workers.storage.export import write_netcdf
from gear_rattle.workers.storage.location import certificates_path
from rattle import Gear, Limit, Machine
from rattle.models import Impacting

HOW_TO = (Path(__file__).parents[3] / "docs" / "how-to" / "service.md").read_text()
#: Answers that are never 200 for data that fit the schema: what does not exist is not found, what is too large for the
#: service's settings, or inconsistent in itself (an axis that falls), is refused.
CONFIG = f"""
[checks]
# 503 is declared: a point at extreme parameters takes longer than a request may (where points are computed at all).
not_a_server_error.expected-statuses = ["2xx", "3xx", "4xx", "503"]
positive_data_acceptance.expected-statuses = ["2xx", "304", "404", "409", "416", "422", "429", "503"]
# Its own list, and 414: a URL that is too long.
negative_data_rejection.expected-statuses = [
    "400", "401", "403", "404", "405", "406", "409", "414", "415", "422", "429", "5xx",
]
# DELETE dismisses a survey that waits or runs, and what it has computed stays until a second one.
use_after_free.enabled = false

[phases.stateful]
# One after the other along the links: from a survey to its points, from where curves meet to basins and attractors.
generation.max-examples = {either(10, 400)}
max-steps = 10
"""
#: One request for every limit of every parameter of these: six thousand. A notebook has the parameters of orbits, and
#: SVG and PDF those of a PNG. Those of a machine orbits have too, and numbers of windows are in test_service_curves.py.
LONG = ["populations", "estimate", "limits", "reached", "attractors", "intensity", "basins.png", "notebook"]
LONG += ["surveys/{survey_id}/map.svg", "surveys/{survey_id}/map.pdf", "machine", "curves"]
QUICK = f"""
[[operations]]
include-path = {[f"/v1/{name}" for name in LONG]}
phases.coverage.enabled = false
"""
FEWER = """
[[operations]]
# One request for every limit of every parameter: at the largest stiffness most of these wait for the longest time.
include-path = ["/v1/basins.png", "/v1/curves"]
phases.coverage.enabled = false
"""


POPULATION = {"gear": {"delta": 0.6, "epsilon": {"distribution": "uniform", "low": 0.05, "high": 0.2}}, "gears": 40}


#: The first DELETE of what is not yet successful dismisses it, and it is there until the second: test_service_jobs.py.
LEFT_OUT = "use_after_free"


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stores of a survey, with its certificates, and of a population, whole."""
    path = tmp_path_factory.mktemp("finished")
    for kind, request in (
        (JobKind.SURVEY, SurveyRequest(**BODY)),
        (JobKind.POPULATION, parse_request_document(POPULATION)),
    ):
        store = path / kind
        create_store(request, store)
        for tile in tiles_of(request):
            write_tile(request, str(store), tile, compute_tile(request, tile)[0])
        finish_store(store)
    with open_survey(path / JobKind.SURVEY) as survey:
        certify_survey(survey, certificates_path(path / JobKind.SURVEY))
    return path


def too_long(*_: Any) -> Any:
    """Raise the error of an overlay that takes too long."""
    raise UnavailableError("This is not found here. Leave it out.")


@contextmanager
def serving(finished: Path, data: Path, **changes: Any) -> Iterator[tuple[str, FastAPI]]:
    """URL and application of a server in this process.

    Its surveys and populations are successful at once, with the numbers of another one; one seed in five fails.
    """

    def compute(manager: Any, survey_id: str, _: Any) -> None:
        if not manager._database.set_state(survey_id, State.RUNNING):
            return
        job = manager._database.job(survey_id)
        if job.request["seed"] % 5 == 1:
            raise SurveyError("no luck")
        store = manager._directory.store(job.id)
        if not store.exists():  # it does after POST …/verify
            shutil.copytree(finished / job.kind, store, copy_function=os.link)
            if job.request.get("certify"):
                shutil.copytree(certificates_path(finished / job.kind), certificates_path(store), copy_function=os.link)
        manager._database.set_state(job.id, State.SUCCESSFUL)

    limits = {"max_jobs": 10**6, "max_point_count": 64, "max_point_seconds": HANG}
    settings = Settings(data=data, **limits | changes)
    app = create_app(settings, idle_cluster)
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_config=None))
    thread = threading.Thread(target=server.run)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(manager.JobManager, "_compute_until_pause", compute)
        for kind, name in (
            (CrisisCurves, "crisis_curve_of"),
            (DesignLimits, "limits_over_damping"),
            (windows, "refine_window"),
        ):
            patch.setattr(kind, name, too_long)
        thread.start()
        try:
            wait_until(lambda: server.started or not thread.is_alive())
            yield f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}", app
        finally:
            server.should_exit = True
            thread.join()


@pytest.fixture(scope="module")
def url(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with points_in(IN_A_THREAD), serving(finished, tmp_path_factory.mktemp("data")) as (url, _):
        yield url


@pytest.fixture(scope="module")
def http(url: str) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=url, timeout=HANG) as http:
        yield http


@pytest.fixture(scope="module")
def document(http: httpx.Client) -> dict[str, Any]:
    found: dict[str, Any] = http.get("/openapi.json").json()
    return found


async def known(_: Any, compute: Any, *arguments: Any, what: str, **words: Any) -> Any:  # noqa: ARG001
    """Return a known result in place of `compute_in_process`, which takes minutes at extreme points."""
    found = {
        "The orbits": lambda: orbits_document(Gear(0.6, 0.1)),
        "The attractors": lambda: Gear(0.6, 0.1).attractors(4),
        "The intensities": lambda: compute_intensities(Gear(0.6, 0.1), 4, None, 0, 1000),
        "The curves": lambda: curves_document(Impacting(0.6), (0.7, 0.8), (0.0, 0.3)),
        "The basins": lambda: b"a picture",
        "The attractors of the states": lambda: Gear(0.6, 0.1).reached([0.2], [0.1]),
        "The cost": lambda: 0.01,
        "The verdict": lambda: Machine(0.003, 0.05, 100e-6, 15e-6, 0.05, rpm=3000.0, restitution=0.7).verdict(4),
        "The limits": lambda: [Limit(0.1, 0.05, 0.2)] * len(arguments[4] or [0.0]),
    }
    return found[what]()


def try_everything(finished: Path, where: Path, config: str, *options: str, **settings: Any) -> None:
    """Let schemathesis ask for all that there is."""
    (where / "schemathesis.toml").write_text(config)
    command = [sys.executable, "-m", "schemathesis.cli", "--config-file", str(where / "schemathesis.toml")]
    always = ["--checks", "all", "--no-color", "--no-shrink", "--warnings", "off"]
    always += ["--generation-deterministic", "--continue-on-failure"]
    always += ["--request-timeout", f"{HANG:g}", "--max-response-time", f"{HANG:g}"]
    with serving(finished, where / "data", require_keys=True, **settings) as (url, app):
        token = add_key(app.state.front.database, "schemathesis", Scope.SUBMIT)[1]
        always += ["--header", f"Authorization: Bearer {token}"]
        run = subprocess.run(
            [*command, "run", f"{url}/openapi.json", *always, *options],
            cwd=where,
            capture_output=True,
            text=True,
            timeout=HANG,
        )
    assert run.returncode == 0, run.stdout + run.stderr
    assert re.search(r"Selected: (\d+)/\1\n\s*Tested: \1\n", run.stdout), run.stdout
    links = re.search(r"API Links:\s+(\d+) covered", run.stdout)
    assert links
    assert int(links[1]) > 10, run.stdout


def test_schemathesis_finds_nothing(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (basin_picture, plane_curves, estimate, intensity, limits, points, reached, verdict):
        monkeypatch.setattr(module, "compute_in_process", known)
    if not DEEP:  # whose file it is makes no difference to these requests, and to write each took a third of all
        with open_survey(finished / JobKind.SURVEY, as_stored=True) as survey, write_netcdf(survey) as file:
            content = file.read()
        monkeypatch.setattr(download, "_write_netcdf", lambda _: BytesIO(content))
    # Requests without a key, or with a wrong one, are in test_service_access.py.
    left_out = either(f"{LEFT_OUT},ignored_auth", LEFT_OUT)
    options = ["--max-examples", either("1", "6"), "--exclude-checks", left_out]
    try_everything(finished, tmp_path, CONFIG + either(QUICK, ""), *options)


@deep
def test_schemathesis_finds_nothing_where_points_are_computed(finished: Path, tmp_path: Path) -> None:
    """A point may be found in time or not (200 or 503): both are correct here."""
    limits = {"max_basin_resolution": 50, "max_point_seconds": 2}
    try_everything(finished, tmp_path, CONFIG + FEWER, "--max-examples", "6", "--exclude-checks", LEFT_OUT, **limits)


def operations(document: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            yield path, method, operation


def test_every_example_of_a_request_is_executed(http: httpx.Client, document: dict[str, Any]) -> None:
    client = Client(http=http)
    survey_id = client.submit(BODY, force=True, certify=True).wait().id
    population_id = client.submit_population(POPULATION, force=True).wait().id
    executed = set()
    for path, method, operation in sorted(operations(document), key=lambda each: each[1] == "delete"):
        examples: dict[str, dict[str, Any]] = {"path": {}, "query": {}, "header": {}}
        for parameter in operation.get("parameters", ()):
            if values := parameter["schema"].get("examples"):
                examples[parameter["in"]][parameter["name"]] = values[0]
            assert values or not parameter["required"], (path, parameter["name"])
        where = path.format(**examples["path"] | {"survey_id": survey_id, "population_id": population_id})
        headers = {name: str(value) for name, value in examples["header"].items()}
        (kind, content), *_ = [*operation.get("requestBody", {}).get("content", {}).items(), ("", {})]
        for body in content["schema"]["examples"] if "examples" in content.get("schema", {}) else [None]:
            sent: dict[str, Any] = {"content": body} if kind == "text/csv" else {"json": body}
            headers |= {"Content-Type": kind} if kind == "text/csv" else {}
            answer = http.request(method, where, params=examples["query"], headers=headers, **sent)
            assert answer.status_code < 400, (method, where, answer.text)
            assert str(answer.status_code) in operation["responses"]
            executed.add((method, path))
    assert len(executed) == len(list(operations(document)))


def test_every_link_leads_from_an_example_to_an_operation_with_what_it_needs(document: dict[str, Any]) -> None:
    by_id = {operation["operationId"]: operation for _, _, operation in operations(document)}
    linked = set()
    for _, _, operation in operations(document):
        for answer in operation["responses"].values():
            for link in answer.get("links", {}).values():
                target = by_id[link["operationId"]]
                model = answer["content"]["application/json"]["schema"]["$ref"].rpartition("/")[2]
                taken = {parameter["name"]: parameter for parameter in target.get("parameters", ())}
                assert {name for name, parameter in taken.items() if parameter["required"]} <= set(link["parameters"])
                for name, expression in link["parameters"].items():
                    value = found_at(examples.ANSWERS[model], expression)
                    jsonschema_rs.validate({**taken[name]["schema"], "components": document["components"]}, value)
                linked.add((operation["operationId"], link["operationId"]))
    assert {to for _, to in linked} >= {"attractors", "basins", "orbits", "curves", "read", "follow", "picture"}
    assert {("submit", "curves"), ("curves", "basins"), ("attractors", "basins"), ("attractors", "intensity")} <= linked


def found_at(body: Any, expression: str) -> Any:
    """Return the value of a link's expression in a body."""
    if not expression.startswith("$response.body#/"):
        return expression
    for part in expression.partition("#/")[2].split("/"):
        body = body[int(part) if isinstance(body, list) else part]
    return body


def test_every_example_of_an_answer_fits_its_schema_and_is_true(http: httpx.Client, document: dict[str, Any]) -> None:
    shown = {name: model for name, model in document["components"]["schemas"].items() if name in examples.ANSWERS}
    assert set(shown) == set(examples.ANSWERS)
    for name, model in shown.items():
        schema = {"$ref": f"#/components/schemas/{name}", "components": document["components"]}
        for example in model["examples"]:
            jsonschema_rs.validate(schema, example)
            assert set(model["required"]) <= set(example), name
    changing = {"id", "created", "content_hash", "links", "state", "started", "finished", "progress", "message"}
    for kind, request, detail in (
        ("surveys", examples.REQUEST, examples.DETAIL),
        ("populations", examples.POPULATION_REQUEST, examples.POPULATION_DETAIL),
    ):
        accepted = http.post(f"/v1/{kind}?force=true", json=request).json()
        for name in set(accepted) - changing:
            assert accepted[name] == detail[name], name
    third = http.post("/v1/surveys?force=true", json=examples.THIRD_AXIS).json()
    assert (third["request"]["beta"], third["cells"]) == (examples.THIRD_AXIS["beta"], 4650)
    lossy = http.post("/v1/surveys?force=true", json=examples.INELASTIC).json()
    assert lossy["request"]["harmonics"] == examples.INELASTIC["harmonics"]
    assert (lossy["request"]["restitution"], lossy["cells"]) == (examples.INELASTIC["restitution"], 84)
    for name, query, example in POINTS:
        answer = http.get(f"/v1/{name}", params=query).json()
        assert_close(first_of_each(answer), example)


POINTS = [
    ("orbits", {"delta": 0.6, "epsilon": 0.1}, examples.ORBITS),
    ("attractors", {"delta": 0.6, "epsilon": 0.1, "count": 16}, examples.ATTRACTORS),
    ("curves", {"delta_min": 0.7, "delta_max": 0.8}, examples.CURVES),
]


def assert_close(found: Any, expected: Any) -> None:
    """Equal, but for the last digits of numbers, which processors may round differently."""
    if isinstance(expected, dict | list):
        assert type(found) is type(expected)
        assert len(found) == len(expected)
        keys = expected if isinstance(expected, dict) else range(len(expected))
        for key in keys:
            assert_close(found[key], expected[key])
    else:
        assert found == (pytest.approx(expected, rel=1e-6) if isinstance(expected, float) else expected)


def first_of_each(value: Any) -> Any:
    """Lists of documents cut to their first one, lists of numbers to their first two: what the examples show."""
    if isinstance(value, dict):
        return {name: first_of_each(item) for name, item in value.items()}
    if isinstance(value, list):
        keep = 1 if value and isinstance(value[0], dict | list) and len(value) > 2 else 2
        return [first_of_each(item) for item in value[:keep]]
    return value


def test_the_lines_of_the_readme_are_executed(
    url: str, http: httpx.Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if shutil.which("curl") is None:
        pytest.skip("curl is not installed")
    section = HOW_TO.replace("http://localhost:8000", url)
    shell, python = (re.findall(rf"```{kind}\n(.*?)```", section, re.DOTALL)[0] for kind in ("sh", "python"))
    survey_id = http.post("/v1/surveys?force=true", json=BODY).json()["id"]
    (tmp_path / ".curlrc").write_text("fail\nsilent\nshow-error\n")
    (tmp_path / "python").symlink_to(sys.executable)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    script = shell.replace("localhost:8000", url.removeprefix("http://")).replace("/ID", f"/{survey_id}")
    *lines, deletion = script.strip().splitlines()
    printed = ""
    for part in ("\n".join(lines), deletion):
        Client(http=http).job(survey_id).wait()  # a survey that is still being verified would only be dismissed
        run = subprocess.run(
            ["bash", "-euxc", part],
            cwd=tmp_path,
            env=os.environ | {"CURL_HOME": str(tmp_path)},
            capture_output=True,
            text=True,
            timeout=HANG,
        )
        assert run.returncode == 0, run.stdout + run.stderr
        printed += run.stdout
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    assert "event: state" in printed
    assert http.get(f"/v1/surveys/{survey_id}").status_code == 404
    names: dict[str, Any] = {}
    exec(python, names)
    assert "region" in names["survey"]


def test_the_commands_use_what_is_there_unless_forced(url: str) -> None:
    options = ["--delta", "0.5:0.7:6", "--epsilon", "0.05:0.15:4", "--count", "8", "--url", url]

    def rattle(*arguments: str) -> str:
        result = CliRunner().invoke(cli, arguments)
        assert result.exit_code == 0, result.output
        return result.output

    first, again, forced = (rattle("submit", *options, *more).strip() for more in ((), (), ("--force",)))
    assert first == again != forced
    assert first in rattle("list", "--url", url)
