"""Mistakes of users get messages: what is wrong, what is allowed, what was probably meant."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi.testclient import TestClient
from service_support import BODY, assert_problem, front_end
from typer.testing import CliRunner

import rattle
from gear_rattle import Client, ServiceError, SurveyError, run_survey
from gear_rattle.service.cli import app
from gear_rattle.workers import Axis, SurveyRequest
from gear_rattle.workers.cluster.window import quantity_of_map
from rattle.errors import did_you_mean

#: Words of pydantic, json and Python, which speak of the program.
FOREIGN = re.compile(
    r"Input should|Field required|Extra inputs|Value error|validation error|Unable to|tagged-union|JSON decode|unpack|"
    r"could not convert|invalid literal|Traceback|pydantic|NoneType"
)
AXES = ("--delta", "0.4:1:3", "--epsilon", "0.1:0.2:3")


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("messages"), explorer=False) as client:
        yield client


def said_by_command(*arguments: str) -> str:
    found = CliRunner().invoke(app, arguments)
    assert found.exit_code == 2 or isinstance(found.exception, rattle.RattleError)
    text = f"{found.output} {found.exception}"
    return " ".join(re.sub(r"[│╭╮╰╯─]", " ", text).split())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--delta", "0.4:1", "--epsilon", "0.1:0.2:3"), "three numbers separated by colons: this text has 2"),
        (("--delta", "0.4:1:many", "--epsilon", "0.1:0.2:3"), "num is 'many', not a whole number"),
        (("--delta", "low:1:3", "--epsilon", "0.1:0.2:3"), "start is 'low', not a number"),
        (("--delta", "0.4:1:1", "--epsilon", "0.1:0.2:3"), "num: must be at least 2, got 1"),
        ((*AXES, "--quantity", "regin"), "did you mean region?"),
        ((*AXES, "--quantity", "lyapunow"), "did you mean lyapunov?"),
        ((*AXES, "--slots-by", "famly"), "did you mean family?"),
        ((*AXES, "--count", "0"), "must be at least 1, got 0"),
        ((*AXES, "--beta", "-1"), "must be greater than 0.0, got -1.0"),
        ((*AXES, "--refine", "--audit", "3"), "must be at most 1.0, got 3.0"),
        (("--rpm", "100:200:3", "--eccentricity", "1e-6:2e-6:3"), "machine.inertia: is not given: give it"),
    ],
)
def test_options(options: tuple[str, ...], words: str) -> None:
    said = said_by_command("run", "--out", "nowhere.zarr", *options)
    assert words in said
    assert not FOREIGN.search(said)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("orbits", "x", "0.1"), 'must be a number, got "x"'),
        (("attractors", "0.6", "0.1", "--count", "many"), 'must be a whole number, got "many"'),
        (("certify", "--columns", "0"), "must be at least 1, got"),
        (
            ("tolerance", "--delta", "0.6", "--epsilon", "normal:0.1:0.01", "--gears", "1", "--out", "nowhere"),
            "gears: must be at least 2, got 1",
        ),
        (("serve", "--port", "999999"), "port: must be at most 65535, got 999999"),
        (("key", "add", "me", "--scope", "all"), "'all' is not one of 'read', 'submit'"),
        (("run", "--delat", "1:2:3"), "--delta"),
        (("verfy", "store"), "Did you mean 'verify'"),
    ],
)
def test_values_that_are_of_another_type(arguments: tuple[str, ...], words: str) -> None:
    said = said_by_command(*arguments)
    assert words in said
    assert not FOREIGN.search(said)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"quantities": ["atractors"]}, "did you mean attractors?"),
        ({"quantites": ["region"]}, "is not a known field: did you mean quantities?"),
        ({"model": "stif"}, "did you mean stiff?"),
        ({"delta": {"start": 0.4, "stop": 1.0, "nun": 3}}, "did you mean num?"),
        ({"delta": {"start": 0.4}}, "is not given: give it"),
        ({"seed": 1.5}, "must be a whole number, got 1.5"),
        ({"certify": "yes"}, 'must be true or false, got "yes"'),
        ({"tile": 5}, "must be an object with named fields, got 5"),
        ({"name": "x" * 201}, "must have at most 200 characters"),
    ],
)
def test_fields_of_a_survey(client: TestClient, changes: dict[str, Any], words: str) -> None:
    problem = assert_problem(client.post("/v1/surveys", json=BODY | changes), 422, words)
    assert not FOREIGN.search(json.dumps(problem))


@pytest.mark.parametrize(
    ("epsilon", "words"),
    [
        ({"distribution": "norml", "mean": 0.1, "deviation": 0.01}, "did you mean normal"),
        ({"mean": 0.1, "deviation": 0.01}, "must name its 'distribution'"),
        ({"distribution": "normal", "mean": "x", "deviation": 0.01}, "mean: must be a number"),
        ("x", 'must be a number, got \\"x\\"'),
    ],
)
def test_numbers_of_a_population(client: TestClient, epsilon: Any, words: str) -> None:
    body = {"gear": {"delta": 0.6, "epsilon": epsilon}}
    answer = client.post("/v1/populations", json=body)
    assert answer.status_code == 422
    assert words in answer.text
    assert not FOREIGN.search(answer.text)
    assert [item["field"] for item in answer.json()["errors"]] == ["body.gear.epsilon"]


@pytest.mark.parametrize("content", [b"{", b"", b"{'a': 1}", b"NaN", b"[1, 2"])
def test_bodies_that_are_no_json(client: TestClient, content: bytes) -> None:
    answer = client.post("/v1/surveys", content=content, headers={"Content-Type": "application/json"})
    assert answer.status_code in (400, 422)
    assert not FOREIGN.search(answer.text)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("/v1/orbits?delta=x&epsilon=0.1", "must be a number"),
        ("/v1/orbits?delta=0.6", "is not given: give it"),
        ("/v1/orbits?delta=0.6&epsilom=0.1", "did you mean epsilon?"),
        ("/v1/surveys?limit=many", "must be a whole number"),
    ],
)
def test_queries(client: TestClient, path: str, words: str) -> None:
    problem = assert_problem(client.get(path), 422)
    assert words in json.dumps(problem)
    assert not FOREIGN.search(json.dumps(problem))


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("quiet", "quiet_fraction"),
        ("regoin", "region"),
        ("Lyapunov_Max", "lyapunov_max"),
        ("atractor_kind", "attractor_kind"),
    ],
)
def test_a_map_that_was_meant_is_named(given: str, meant: str) -> None:
    request = SurveyRequest(delta=(0.4, 1.0, 3), epsilon=(0.1, 0.2, 3))
    with pytest.raises(SurveyError, match=rf"there is no map '{given}': did you mean {meant}"):
        quantity_of_map(given, 0, request)


def test_names_of_the_library_too() -> None:
    with pytest.raises(rattle.ParameterError, match=r"one of SN1, .*, got 'SN': did you mean SN1 or SN2\?"):
        rattle.curves.trace("SN")
    with pytest.raises(rattle.ParameterError, match=r"did you mean epsilon\?"):
        rattle.population({"delta": 0.6, "epsilom": 0.1})


@pytest.mark.parametrize("name", ["", "x" * 1000, None, 5, "zzz", "\x00"])
def test_nothing_is_meant_by_what_is_like_nothing(name: object) -> None:
    assert did_you_mean(name, ["region", "orbits"]) == ""


def test_python_says_the_same() -> None:
    with pytest.raises(SurveyError, match=r"quantities.0: must be one of .* did you mean region\?") as refused:
        run_survey(delta=(0.4, 1.0, 3), epsilon=(0.1, 0.2, 3), quantities=("regin",))
    assert not FOREIGN.search(str(refused.value))
    with pytest.raises(SurveyError, match="this text has 4"):
        Axis.parse("1:2:3:4")


@pytest.mark.parametrize("header", ["tme,speed", "", "1,2"])
def test_tables(tmp_path: Path, header: str) -> None:
    (tmp_path / "impacts.csv").write_text(f"{header}\n1,2\n" if header else "")
    said = said_by_command("compare", str(tmp_path / "impacts.csv"), "0.6", "0.1")
    assert "must name its columns: time is required, and the others may be speed, wall; it has" in said
    assert ("did you mean time?" in said) == (header == "tme,speed")


def test_another_program_at_the_address_is_no_service() -> None:
    def answer(_: httpx.Request) -> httpx.Response:
        return httpx.Response(200, text="<html>It works!</html>")

    with (
        Client(http=httpx.Client(transport=httpx.MockTransport(answer), base_url="http://example")) as client,
        pytest.raises(ServiceError, match="which is not a JSON object, so another program may be at http://example"),
    ):
        client.job("0" * 16)
    with Client() as client, pytest.raises(ServiceError, match="give finite numbers"):
        client.submit({"beta": float("nan")})
