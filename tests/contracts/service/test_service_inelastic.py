"""The inelastic model over REST: what the library says with restitution, load and harmonics, and what is refused."""

import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from service_support import BODY, IN_A_THREAD, assert_problem, front_end
from typer.testing import CliRunner

import rattle
import rattle.plot
from gear_rattle.service.cli import app
from gear_rattle.workers import run_survey

POINT = "delta=0.6&epsilon=0.25&beta=0.6"
GEAR = "restitution=0.6&load=0.3&harmonic=3:0.12:0.3&harmonic=8:0.03:0.6"
HARMONICS = [(3, 0.12, 0.3), (8, 0.03, 0.6)]


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("inelastic"), points=IN_A_THREAD) as client:
        yield client


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("store") / "survey.zarr"
    axes = {"delta": (0.5, 0.7, 2), "epsilon": (0.2, 0.3, 2)}
    asked = {"initial_conditions": {"count": 4}, "quantities": ("attractors",)}
    run_survey(model="inelastic", restitution=0.9, out=path, **axes, **asked).close()
    return path


def library() -> rattle.inelastic.InelasticGear:
    return rattle.Gear(0.6, 0.25, 0.6, restitution=0.6, load=0.3, harmonics=HARMONICS)


def test_attractors(client: TestClient) -> None:
    found = client.get(f"/v1/attractors?{POINT}&{GEAR}&count=16").json()
    assert (found["restitution"], found["load"], found["kappa"]) == (0.6, 0.3, None)
    assert [tuple(each) for each in found["harmonics"]] == HARMONICS
    known = library().attractors(16)
    labels = [
        (each["kind"], each["m"], each["n_plus"], each["n_minus"], each["contacts"]) for each in found["attractors"]
    ]
    assert labels == [(each.kind, each.m, each.n_plus, each.n_minus, each.contacts) for each in known]
    assert any(each["contacts"] for each in found["attractors"])
    assert all(each["lyapunov"] == [None, None] for each in found["attractors"] if each["contacts"])


def test_intensity(client: TestClient) -> None:
    found = client.get(f"/v1/intensity?{POINT}&{GEAR}&count=16").json()["attractors"]
    gear = library()
    known = [gear.intensity(each) for each in gear.attractors(16)]
    assert [each["energy"] for each in found] == [each.energy for each in known]
    assert [each["contact"] for each in found] == [each.contact for each in known]


def test_orbits_and_curves(client: TestClient) -> None:
    found = client.get("/v1/orbits?delta=0.6&epsilon=0.1&restitution=0.9").json()
    gear = rattle.Gear(0.6, 0.1, restitution=0.9)
    assert (found["region"], found["sn1"], found["harmonics"]) == (gear.region(), gear.sn1, [])
    assert [each["v"] for each in found["orbits"]] == [each.v for each in gear.orbits()]
    with_mesh = client.get(f"/v1/orbits?{POINT}&{GEAR}").json()
    assert (with_mesh["region"], with_mesh["region_name"]) == (None, None)
    assert with_mesh["quiet_limit"] == library().quiet_limit
    assert client.get("/v1/curves?restitution=0.9&load=0").status_code == 200


def test_basins_reached_and_notebook(client: TestClient) -> None:
    pictures = [
        client.get(f"/v1/basins.png?{POINT}&resolution=20&restitution=0.6{more}") for more in ("", "&harmonic=3:0.3:0")
    ]
    assert all(each.content.startswith(b"\x89PNG") for each in pictures)
    assert pictures[0].content != pictures[1].content
    reached = client.get(f"/v1/reached?{POINT}&{GEAR}&tau=0.2&v=3")
    assert reached.status_code == 200, reached.text
    notebook = client.get(f"/v1/notebook?{POINT}&{GEAR}").json()
    text = "".join("".join(cell["source"]) for cell in notebook["cells"])
    assert "with_harmonics(model, [(3, 0.12, 0.3), (8, 0.03, 0.6)])" in text
    assert "diagram" not in text.split("gear.orbits()")[1].split("basins", 1)[1].split("\n\n")[-1]


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("restitution=0", "restitution"),
        ("restitution=1.2", "restitution"),
        ("restitution=nan", "restitution"),
        ("restitution=0.9&load=-1", "load"),
        ("load=0.5", "give restitution too"),
        ("harmonic=3:0.1:0", "give restitution"),
        ("restitution=0.9&kappa=1e4", "together"),
        ("restitution=0.9&harmonic=0:0.1:0", "is a constant"),
        ("restitution=0.9&harmonic=1:0.1:0", "the eccentricity itself"),
        ("restitution=0.9&harmonic=3:0.1:0&harmonic=3:0.2:0", "twice"),
        ("restitution=0.9&harmonic=3:-0.1:0", "half a turn"),
        ("restitution=0.9&harmonic=3:nan:0", "finite"),
        ("restitution=0.9&harmonic=3:0.1", "ORDER:AMPLITUDE:PHASE"),
        ("restitution=0.9&harmonic=2.5:0.1:0", "ORDER:AMPLITUDE:PHASE"),
        ("restitution=0.9&harmonic=1001:0.1:0", "at most 1000"),
        ("restitution=0.9&" + "&".join(f"harmonic={k}:0.001:0" for k in range(2, 67)), "64"),
    ],
)
@pytest.mark.parametrize("route", ["attractors", "orbits", "intensity", "notebook"])
def test_a_bad_number_is_answered_by_a_sentence(client: TestClient, query: str, words: str, route: str) -> None:
    assert_problem(client.get(f"/v1/{route}?delta=0.6&epsilon=0.1&{query}"), 422, words)


def test_a_survey_keeps_its_harmonics(client: TestClient) -> None:
    body = BODY | {"model": "inelastic", "restitution": 0.9, "harmonics": [[3, 0.12, 0.3]]}
    made = client.post("/v1/surveys", json=body)
    assert made.status_code == 202, made.text
    request = client.get(made.headers["location"]).json()["request"]
    assert (request["restitution"], request["load"]) == (0.9, 0.0)
    assert request["harmonics"] == [[3, 0.12, 0.3]]
    again = client.post("/v1/surveys", json=body)
    assert again.json()["id"] == made.json()["id"]
    other = client.post("/v1/surveys", json=body | {"harmonics": [[3, 0.12, 0.31]]})
    assert other.json()["id"] != made.json()["id"]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"model": "inelastic"}, "needs restitution"),
        ({"restitution": 0.9}, "inelastic"),
        ({"model": "inelastic", "restitution": 0.0}, "body.restitution"),
        ({"model": "inelastic", "restitution": {"start": 0.8, "stop": 1.2, "num": 3}}, "restitution"),
        ({"model": "inelastic", "restitution": 0.9, "load": -1.0}, "load"),
        ({"model": "inelastic", "restitution": 0.9, "harmonics": [[1, 0.1, 0.0]]}, "the eccentricity itself"),
        ({"model": "inelastic", "restitution": 0.9, "harmonics": [[3, 0.1]]}, "harmonics"),
        ({"harmonics": [[3, 0.1, 0.0]]}, "takes no harmonics"),
        ({"model": "inelastic", "restitution": 0.9, "quantities": ["grazing"]}, "has no grazing"),
        ({"model": "inelastic", "restitution": 0.9, "certify": True}, "leave certify out"),
    ],
)
def test_a_survey_that_cannot_be_is_refused(client: TestClient, fields: dict[str, object], words: str) -> None:
    assert_problem(client.post("/v1/surveys", json=BODY | fields), 422, words)


LOSSY = {"delta": 0.5, "beta": 0.05, "restitution": 0.2}
FEW = {"share": 0.8, "count": 32}


@pytest.mark.parametrize(
    ("of", "given"),
    [
        ("load", LOSSY | {"epsilon": 0.4}),
        ("restitution", {"delta": 0.6, "epsilon": 0.1}),
        ("harmonic_12", LOSSY | {"epsilon": 0.05}),
    ],
)
def test_limits_are_those_of_the_library_and_of_the_command(
    client: TestClient, of: str, given: dict[str, float]
) -> None:
    answer = client.get("/v1/limits", params=given | FEW | {"of": of})
    assert answer.status_code == 200, answer.text
    found = rattle.design_limit(given, of, FEW["share"], count=32)
    known = {name: None if math.isnan(value) else value for name, value in found._asdict().items()}
    assert answer.json()["limits"] == [{"at": None, **known}]
    options = [word for name, value in (given | FEW).items() for word in (f"--{name}", f"{value}")]
    done = CliRunner().invoke(app, ["limit", of, *options])
    assert done.exit_code == 0, done.output
    assert done.output.startswith(f"{of} {'down' if of == 'load' else 'up'} to {found.value:.4g} [")


def test_a_limit_of_something_else_is_refused_once(client: TestClient) -> None:
    problem = assert_problem(client.get("/v1/limits?of=harmonic_0&delta=0.6&epsilon=0.1"), 422, "harmonic_12")
    assert [each["field"] for each in problem["errors"]] == ["query.of"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "certify --point 0.6 0.1 --restitution 0.9",
            "A proof of periodic motions is available only for the impacting",
        ),
        ("certify {store}", "A proof of periodic motions is available only for the impacting"),
        ("certify {store} --curves", "A proof of a bifurcation is available only for the impacting"),
        ("explain {store}", "An explanation of boundaries is available only for the impacting"),
        ("figure 5 --restitution 0.9", "No such option"),
        ("diagram --delta 0.6 --epsilon 0.05:0.15 --restitution 0.9", "use the impacting or the stiff gear"),
        ("orbits 0.6 0.1 --harmonic 20:0.1:0", "give restitution"),
        ("orbits 0.6 0.1 --load 0.5", "give restitution too"),
        ("attractors 0.6 0.1 --restitution 0.9 --harmonic 20:0.1", "ORDER:AMPLITUDE:PHASE"),
        ("run --out x.zarr --delta 0.5:0.7:3 --epsilon 0.1:0.2:2 --restitution 0.9 --certify", "leave certify out"),
    ],
)
def test_a_command_that_cannot_be_is_refused_by_a_sentence(store: Path, words: str, said: str) -> None:
    done = CliRunner().invoke(app, words.format(store=store).split(), env={"COLUMNS": "200"})
    assert done.exit_code != 0
    text = f"{done.output} {done.exception}"
    assert said in text
    assert isinstance(done.exception, SystemExit | rattle.RattleError), done.exception


def test_what_proves_and_draws_says_so_itself() -> None:
    gear = rattle.Gear(0.6, 0.1, restitution=0.9)
    (orbit,) = (each for each in gear.orbits() if each.name == "C")
    with pytest.raises(rattle.ParameterError, match="of the impacting or the stiff gear, got InelasticOrbit"):
        rattle.certify(gear.orbit(orbit.tau, orbit.v, 1))  # type: ignore[arg-type]
    with pytest.raises(rattle.ParameterError, match="no restitution, which the inelastic model adds: leave it out"):
        rattle.plot.request(5, restitution=0.9)
