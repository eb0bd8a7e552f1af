"""The promises of docker-compose.yml and the Dockerfile; test_compose_commands.py runs the commands."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[3]
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
SERVICES: dict[str, Any] = COMPOSE["services"]
DOCKERFILE = (ROOT / "Dockerfile").read_text().replace("\\\n", " ")
VERSION = "rattle/_version.py"  # all of ours that the layer before has
OURS = ("scheduler", "worker", "front")


def lines(instruction: str) -> list[str]:
    return re.findall(rf"^{instruction} (.*)$", DOCKERFILE, re.MULTILINE)


def test_dask_stays_on_a_network_without_a_way_out() -> None:
    assert COMPOSE["networks"]["cluster"]["internal"] is True
    for name in ("scheduler", "worker"):
        assert SERVICES[name]["command"][0] == "dask"
        assert SERVICES[name]["networks"] == ["cluster"], name


def test_the_database_is_reached_by_the_front_only() -> None:
    assert COMPOSE["networks"]["database"]["internal"] is True
    assert {name for name, each in SERVICES.items() if "database" in each["networks"]} == {"postgres", "front"}


def test_only_the_proxy_is_published_on_loopback_and_the_front_asks_for_keys() -> None:
    published = {name: each["ports"] for name, each in SERVICES.items() if "ports" in each}
    assert published == {"proxy": ["${RATTLE_PUBLISH:-127.0.0.1:8000:8000}"]}
    outside = {name for name, each in COMPOSE["networks"].items() if not (each or {}).get("internal")}
    assert {name for name, each in SERVICES.items() if outside & set(each["networks"])} == {"proxy"}
    assert not any("network_mode" in each for each in SERVICES.values())
    assert "--insecure" not in SERVICES["front"]["command"]
    assert SERVICES["front"]["environment"]["RATTLE_REQUIRE_KEYS"] == "true"


@pytest.mark.parametrize("name", SERVICES)
def test_each_service_is_confined(name: str) -> None:
    service = SERVICES[name]
    assert str(service["user"]) not in ("0", "root")
    assert service["read_only"] is True
    assert "/tmp" in service["tmpfs"]
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["restart"] == "unless-stopped"
    assert "privileged" not in service
    for volume in service.get("volumes", []):
        assert volume.partition(":")[0] in COMPOSE["volumes"], volume
    image = service["image"]
    assert image == "gear-rattle" or re.fullmatch(r"[a-z]+:\d[\w.\-]*", image), image
    assert "test" in service["healthcheck"] or name == "worker"  # the file says why


def test_everything_starts_after_what_it_needs() -> None:
    for name, service in SERVICES.items():
        for other, how in service.get("depends_on", {}).items():
            assert how == {"condition": "service_healthy"}, name
            assert "test" in SERVICES[other]["healthcheck"]


def test_no_password_is_written_down() -> None:
    settings = [item for service in SERVICES.values() for item in service.get("environment", {}).items()]
    secrets = {name: value for name, value in settings if "PASSWORD" in name}
    assert set(secrets) == {"POSTGRES_PASSWORD", "PGPASSWORD"}
    assert all(value.startswith("${POSTGRES_PASSWORD:?") for value in secrets.values())
    assert not any(re.search(r"//[^/@]*:[^/@]*@", str(value)) for _, value in settings)


def test_the_kernels_have_a_place_that_can_be_written() -> None:
    cache = re.search(r"RATTLE_CACHE_DIR=(\S+)", DOCKERFILE)
    assert cache is not None
    for name in ("worker", "front"):
        assert f"cache:{cache[1]}" in SERVICES[name]["volumes"]
    assert f"chown rattle /data {cache[1]}" in DOCKERFILE


def test_the_image_runs_as_the_user_of_the_compose_file() -> None:
    assert lines("USER") == ["1000"]
    assert "--uid 1000 " in DOCKERFILE
    assert all(SERVICES[name]["user"] == "1000:1000" for name in OURS)


def test_the_image_holds_the_packages_and_nothing_else() -> None:
    sources = [word for line in lines("COPY") if not line.startswith("--from") for word in line.split()[:-1]]
    assert all((ROOT / source).exists() for source in sources)
    ignored = (ROOT / ".dockerignore").read_text().splitlines()
    assert ignored[0] == "*"
    assert {line[1:] for line in ignored if line.startswith("!")} == {source for source in sources if source != VERSION}
    assert {"rattle", "workers", "service", "gear_rattle", "pyproject.toml", "constraints.txt"} <= set(sources)
    assert all(re.fullmatch(r"python:\d+\.\d+-slim( AS builder)?", line) for line in lines("FROM"))


def test_the_image_installs_extras_that_exist_at_pinned_versions() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    install, again = (line for line in lines("RUN") if "pip install" in line)
    assert "--no-deps" in again  # ours alone, after the others' layer
    assert "--constraint constraints.txt" in install
    named = re.search(r"\[(.*)\]", install)
    assert named is not None
    assert set(named[1].split(",")) == {"service", "postgres", "s3"} <= set(extras)


def test_the_image_and_the_front_ask_the_same_of_their_health() -> None:
    assert str(SERVICES["front"]["healthcheck"]["test"][-1]) in DOCKERFILE
