"""What docker-compose.yml opens to whom."""

from pathlib import Path
from typing import Any

import pytest
import yaml

COMPOSE: dict[str, Any] = yaml.safe_load((Path(__file__).parents[2] / "docker-compose.yml").read_text())
SERVICES: dict[str, Any] = COMPOSE["services"]


def test_dask_stays_on_a_network_without_a_way_out() -> None:
    assert COMPOSE["networks"]["cluster"]["internal"] is True
    dask = {name: each for name, each in SERVICES.items() if "dask" in each["command"]}
    assert dask
    for name, each in dask.items():
        assert each["networks"] == ["cluster"], name
        assert "ports" not in each, name
        assert "network_mode" not in each, name


@pytest.mark.parametrize("name", SERVICES)
def test_what_is_published_is_published_on_loopback(name: str) -> None:
    for port in SERVICES[name].get("ports", []):
        assert port.startswith("127.0.0.1:"), port


def test_no_keys_are_asked_only_where_the_port_is_published_on_loopback() -> None:
    open_ones = [name for name, each in SERVICES.items() if "--insecure" in each["command"]]
    assert open_ones == ["front"]
    assert SERVICES["front"]["ports"]
