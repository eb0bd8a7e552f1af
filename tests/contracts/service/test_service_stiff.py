"""The stiff model over REST: what the library says, at the stiffness of the request."""

from collections.abc import Iterator

import pytest
from fastapi.testclient import TestClient
from service_support import BODY, IN_A_THREAD, assert_problem, front_end

from rattle import stiff

POINT = "delta=0.6&epsilon=0.075&beta=0.6"


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("stiff"), points=IN_A_THREAD) as client:
        yield client


def test_orbits(client: TestClient) -> None:
    gear = stiff.StiffGear(0.6, 0.075, 0.6, 1e4)
    found = client.get(f"/v1/orbits?{POINT}&kappa=1e4").json()
    assert (found["kappa"], found["region"]) == (1e4, gear.region())
    assert found["sn1"] == pytest.approx(gear.sn1)
    assert found["flip"] is None
    assert found["quiet_limit"] == gear.quiet_limit
    assert [(each["name"], each["stable"]) for each in found["orbits"]] == [
        (each.name, each.stable) for each in gear.orbits()
    ]
    assert [each["v"] for each in found["orbits"]] == pytest.approx([each.v for each in gear.orbits()])
    assert client.get(f"/v1/orbits?{POINT}").json()["kappa"] is None


def test_attractors(client: TestClient) -> None:
    found = client.get(f"/v1/attractors?{POINT}&kappa=1e4&count=16").json()
    known = stiff.StiffGear(0.6, 0.075, 0.6, 1e4).attractors(16)
    assert [(each["kind"], each["fraction"]) for each in found["attractors"]] == [
        (each.kind, each.fraction) for each in known
    ]


def test_curves(client: TestClient) -> None:
    window = "delta_min=0.55&delta_max=0.65&epsilon_min=0.04&epsilon_max=0.07"
    found = client.get(f"/v1/curves?{window}&kappa=1e4").json()
    assert found["kappa"] == 1e4
    assert found["points"] == []
    curves = {each["name"]: each for each in found["curves"]}
    assert set(curves) == set(stiff.NAMES)
    line = curves["SN1"]
    assert line["missing"] is None
    for delta, epsilon in list(zip(line["delta"], line["epsilon"], strict=True))[::20]:
        assert epsilon == pytest.approx(stiff.StiffGear(delta, 0.0, 0.6, 1e4).sn1, abs=1e-9)


def test_basins(client: TestClient) -> None:
    pictures = [
        client.get(f"/v1/basins.png?{POINT}&resolution=20{stiffness}") for stiffness in ("", "&kappa=100", "&kappa=1e4")
    ]
    assert all(each.content.startswith(b"\x89PNG") for each in pictures)
    assert len({each.content for each in pictures}) == 3


def test_a_survey_is_accepted_with_its_model(client: TestClient) -> None:
    made = client.post("/v1/surveys", json=BODY | {"model": "stiff", "kappa": 1e4})
    assert made.status_code == 202, made.text
    request = client.get(made.headers["location"]).json()["request"]
    assert (request["model"], request["kappa"]) == ("stiff", 1e4)
    assert "grazing" not in request["quantities"]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"model": "stiff"}, "needs kappa"),
        ({"kappa": 1e4}, "stiff"),
        ({"model": "stiff", "kappa": -1.0}, "body.kappa"),
        ({"model": "soft", "kappa": 1e4}, "body.model"),
        ({"model": "stiff", "kappa": 1e4, "quantities": ["grazing"]}, "has no grazing"),
    ],
)
def test_what_does_not_go_together_is_refused(client: TestClient, fields: dict[str, object], words: str) -> None:
    assert_problem(client.post("/v1/surveys", json=BODY | fields), 422, words)


@pytest.mark.parametrize("kappa", ["0", "-1", "nan", "inf", "1e11", "x"])
@pytest.mark.parametrize("what", ["orbits", "attractors", "basins.png"])
def test_no_stiffness(client: TestClient, what: str, kappa: str) -> None:
    assert_problem(client.get(f"/v1/{what}?{POINT}&kappa={kappa}"), 422, "query.kappa")
