"""The command ``rattle key``, beside a running service, and a service that refuses to start open."""

import re
import socket
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
from fastapi.testclient import TestClient
from service_support import BODY, assert_problem, front_end, front_of
from typer.testing import CliRunner

from gear_rattle.service import cli
from gear_rattle.service.client import Client
from gear_rattle.service.commands.serve import require_keys
from gear_rattle.service.database import Database
from gear_rattle.service.errors import ServiceError
from gear_rattle.service.results import api_key_headers, open_results
from gear_rattle.service.settings import Settings


def rattle(*arguments: str) -> Any:
    """A command that succeeds."""
    result = CliRunner().invoke(cli.app, arguments)
    assert result.exit_code == 0, result.output
    return result


def refusal(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Return the message of a refused command."""
    monkeypatch.setattr("sys.argv", ["rattle", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    return re.sub(r"\s+", " ", capsys.readouterr().err)


def test_keys_come_and_go_while_the_service_runs(tmp_path: Path) -> None:
    data = ["--data", str(tmp_path)]
    with front_end(tmp_path, require_keys=True) as client:
        added = rattle("key", "add", "[red]Ann", "--scope", "submit", "--max-cells", "30", "--max-running", "2", *data)
        token = added.stdout.strip()
        assert "cannot be shown again" in added.stderr
        headers = {"Authorization": f"Bearer {token}"}
        assert client.post("/v1/surveys", json=BODY, headers=headers).status_code == 202
        assert_problem(client.post("/v1/surveys", json=BODY | {"seed": 1}, headers=headers), 403, code="quota_exceeded")

        (key,) = front_of(client).database.keys()
        assert (key.name, key.scopes, key.max_cells, key.max_running) == ("[red]Ann", ["read", "submit"], 30, 2)
        listed = rattle("key", "list", *data).output
        assert key.id in listed
        assert "[red]Ann" in listed
        assert token[-43:] not in listed
        assert key.hash not in listed

        rattle("key", "revoke", key.id, *data)
        assert_problem(client.get("/v1/surveys", headers=headers), 401, code="unauthorized")
        reader = {"Authorization": f"Bearer {rattle('key', 'add', 'Bob', *data).stdout.strip()}"}
        assert client.get("/v1/surveys", headers=reader).status_code == 200
        assert_problem(client.post("/v1/surveys", json=BODY, headers=reader), 403)


def test_the_first_key_is_made_before_the_first_start(tmp_path: Path) -> None:
    token = rattle("key", "add", "Ann", "--data", str(tmp_path / "new" / "data")).stdout.strip()
    with front_end(tmp_path / "new" / "data", require_keys=True) as client:
        assert client.get("/v1/surveys", headers={"Authorization": f"Bearer {token}"}).status_code == 200


def test_what_cannot_be_done_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    refused = [monkeypatch, capsys]
    assert "has no job database" in refusal(*refused, "key", "list", "--data", str(tmp_path / "none"))
    assert not (tmp_path / "none").exists()
    assert "has no job database" in refusal(*refused, "key", "list", "--data", str(tmp_path))
    assert list(tmp_path.iterdir()) == []
    rattle("key", "add", "Ann", "--data", str(tmp_path))
    assert "no key 'abc'" in refusal(*refused, "key", "revoke", "abc", "--data", str(tmp_path))
    for name in ("", "a\nb", "x" * 101, "\udcff"):
        result = CliRunner().invoke(cli.app, ["key", "add", "--data", str(tmp_path), "--", name])
        assert result.exit_code == 2, name
    for wrong in (["--scope", "admin"], ["--max-cells", "0"], ["--max-running", "-1"], ["--max-cells", str(2**31)]):
        assert CliRunner().invoke(cli.app, ["key", "add", "Ann", "--data", str(tmp_path), *wrong]).exit_code == 2


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "gear.invalid"])
def test_a_service_that_everybody_reaches_does_not_start_without_keys(
    host: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    serve = ["serve", "--host", host, "--port", "0", "--data", str(tmp_path)]
    assert "rattle key add" in refusal(monkeypatch, capsys, *serve)
    token = rattle("key", "add", "Ann", "--data", str(tmp_path)).stdout
    rattle("key", "revoke", token.split("_")[1], "--data", str(tmp_path))
    assert "--insecure" in refusal(monkeypatch, capsys, *serve)
    monkeypatch.setenv("RATTLE_REQUIRE_KEYS", "true")
    assert "rattle key add" in refusal(monkeypatch, capsys, "serve", "--port", "0", "--data", str(tmp_path))
    assert "contradict" in refusal(monkeypatch, capsys, *serve, "--insecure")


@pytest.mark.parametrize(
    ("host", "options", "keys"),
    [("0.0.0.0", ["--insecure"], 0), ("0.0.0.0", [], 1), ("127.0.0.1", [], 0), ("localhost", [], 0)],
)
def test_a_service_starts_on_loopback_with_a_key_or_when_told(
    host: str, options: list[str], keys: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[str] = []

    def run(server: Any, sockets: list[socket.socket]) -> None:
        started.append(sockets[0].getsockname()[0])
        server.started = True
        for each in sockets:
            each.close()

    monkeypatch.setattr("uvicorn.Server.run", run)
    for _ in range(keys):
        rattle("key", "add", "Ann", "--data", str(tmp_path))
    rattle("serve", "--host", host, "--port", "0", "--data", str(tmp_path), *options)
    assert started in ([socket.gethostbyname(host)], ["::1"] if host == "localhost" else [])


def test_a_password_in_the_url_of_the_database_is_not_repeated(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/jobs.sqlite?timeout=7"
    with closing(Database(url)) as database, pytest.raises(ServiceError) as refused:
        require_keys(Settings(host="0.0.0.0", data=tmp_path, database_url=url), database)
    assert "timeout=7" not in str(refused.value)


def test_the_client_sends_its_key_with_every_request(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    token = rattle("key", "add", "Ann", "--scope", "submit", "--data", str(tmp_path)).stdout.strip()
    with front_end(tmp_path, require_keys=True) as http:
        with pytest.raises(ServiceError, match="API key") as refused:
            Client(http=http).submit(BODY)
        assert refused.value.status == 401
        job = Client(http=http, key=token).submit(BODY, idempotency_key="one")
        monkeypatch.setenv("RATTLE_API_KEY", f"{token}\n")
        client = Client(http=http)
        assert client.job(job.id).document == job.document
        assert [each.id for each in client.surveys()] == [job.id]
        assert client.submit(BODY, idempotency_key="one").id == job.id
        client.job(job.id).delete()
        states = [data["state"] for _, data in client.events(job.document["links"]["events"], after=0)]
        assert states == ["accepted", "dismissed"]


def test_a_key_of_other_characters_is_refused_before_it_is_sent() -> None:
    assert api_key_headers("") == {}
    for wrong in ("kéy", "a\nb", "a\x00"):
        with pytest.raises(ServiceError, match="RATTLE_API_KEY"):
            api_key_headers(wrong)


def test_the_client_needs_no_key_on_loopback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RATTLE_API_KEY", "of another service")
    http: TestClient
    with front_end(tmp_path) as http:
        assert Client(http=http).submit(BODY).state == "accepted"


def test_a_key_goes_to_nobody_but_this_machine_and_the_named_service(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RATTLE_API_KEY", "secret")
    sent: list[dict[str, str]] = []

    def open_zarr(_: str, storage_options: dict[str, dict[str, str]], **__: object) -> xr.Dataset:
        sent.append(storage_options["headers"])
        return xr.Dataset()

    monkeypatch.setattr("xarray.open_zarr", open_zarr)
    store = "/v1/surveys/0123456789abcdef/store"
    for named in ("", "https://service.example", "http://service.example:8000", "https://service.example.evil"):
        monkeypatch.setenv("RATTLE_URL", named)
        with pytest.raises(ServiceError, match="RATTLE_URL"):
            open_results(f"https://service.example:8000{store}")
    assert not sent
    open_results(f"http://127.0.0.1:8000{store}")
    monkeypatch.setenv("RATTLE_URL", "https://service.example:8000")
    open_results(f"https://service.example:8000{store}")
    assert sent == [{"Authorization": "Bearer secret"}] * 2
