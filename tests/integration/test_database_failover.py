"""The server of the job database is lost for good in the middle of a survey, and its standby takes over."""

import signal
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from depth import deep
from faults import IN_PROCESS, REQUEST, Faults
from postgres import Postgres, missing
from service_processes import assert_bit_identical, client_of, free_port, serial_run, server
from waiting import wait_until

from gear_rattle.service.client import Client
from gear_rattle.service.errors import ResponseError

MIDDLE = 3  # tiles that are done while the others are held


@pytest.fixture
def primary() -> Iterator[Postgres]:
    """Yield a database server of this test's own, because the test destroys it."""
    with closing(Postgres()) as server:
        yield server


@deep
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_a_survey_goes_on_with_the_standby(primary: Postgres, tmp_path: Path) -> None:
    faults, port = Faults(tmp_path), free_port()
    faults.inject(IN_PROCESS)
    faults.hold(MIDDLE)
    url = primary.create()
    with closing(Postgres(primary)) as standby:
        settings = faults.environment | {"RATTLE_DATABASE_URL": primary.or_else(url, standby)}
        with server(tmp_path / "data", port, settings=settings), client_of(port) as client:
            job = client.submit(REQUEST)
            wait_until(lambda: job.refresh().document["tiles_done"] == MIDDLE and faults.executions()[MIDDLE])
            primary.stop(signal.SIGQUIT)
            with pytest.raises(ResponseError, match="database cannot answer") as refused:
                client.call("GET", "/v1/surveys")
            assert refused.value.status == 503
            faults.release()
            standby.execute("SELECT pg_promote()")
            found = wait_until(lambda: answered(client, job.id))
            assert found["tiles_done"] >= MIDDLE  # no tile that the service had reported is lost
            assert job.wait().document["tiles_done"] == REQUEST.n_tiles
            assert_bit_identical(job.open(), serial_run(REQUEST))
            following = client.submit(REQUEST.model_copy(update={"seed": 1})).wait()
            assert following.state == "successful"  # the service holds the lock and writes as before
    assert faults.executions().total() <= 2 * REQUEST.n_tiles + 1


def answered(client: Client, survey_id: str) -> dict[str, int] | None:
    """Return the document of a survey, or None while the service has not found its database again."""
    try:
        found: dict[str, int] = client.job(survey_id).document
    except ResponseError as error:
        if error.status != 503:
            raise
        return None
    return found
