"""Points at the ends of double precision are answered, in JSON that has neither NaN nor infinity."""

import json
from collections.abc import Iterator

import pytest
from depth import either
from fastapi.testclient import TestClient
from service_support import IN_A_THREAD, assert_problem, front_end

ORDINARY = {"delta": "0.6", "epsilon": "0.1", "beta": "0.6"}
EXTREMES = [
    *({"delta": value} for value in either(("5e-324", "1e300"), ("5e-324", "1e-300", "1e-9", "1e6", "1e300"))),
    *({"epsilon": value} for value in either(("0", "5e-324", "1e6"), ("0", "5e-324", "1e-300", "1e6"))),
    *({"beta": value} for value in either(("5e-324", "1e300"), ("5e-324", "1e-300", "1e-9", "1e6", "1e300"))),
]


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), points=IN_A_THREAD) as client:
        yield client


def refuse(constant: str) -> None:
    raise AssertionError(f"{constant} is no JSON")


@pytest.mark.parametrize("extreme", EXTREMES, ids=str)
def test_a_point_is_answered(client: TestClient, extreme: dict[str, str]) -> None:
    for route, sample in (("orbits", {}), ("attractors", {"count": 1}), ("basins.png", {"resolution": 2})):
        if route == "basins.png" and "beta" not in extreme:
            continue  # Γ and its images take minutes
        answer = client.get(f"/v1/{route}", params=ORDINARY | extreme | sample)
        assert answer.status_code == 200, answer.text
        if route == "basins.png":
            assert answer.content.startswith(b"\x89PNG")
        else:
            document = json.loads(answer.text, parse_constant=refuse)
            assert {name: float(value) for name, value in extreme.items()}.items() <= document.items()


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/v1/orbits?delta=0.6&epsilon=3.25e16&kappa=6e7", 422),
        ("/v1/curves?beta=1.2e-7&delta_min=2.3e-308&epsilon_max=857326", 200),
    ],
)
def test_what_cannot_be_computed_is_no_error_of_the_service(client: TestClient, path: str, status: int) -> None:
    answer = client.get(path)
    if status == 200:
        assert answer.status_code == 200, answer.text
        assert answer.json()["points"] == []
    else:
        assert_problem(answer, status, "cannot be followed", "choose another point")
