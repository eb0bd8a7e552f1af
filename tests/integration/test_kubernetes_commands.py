"""The commands and environment of deploy/kubernetes, run as processes: PostgreSQL, scheduler, worker, front."""

from contextlib import ExitStack
from pathlib import Path

import postgres
import pytest
import yaml
from containers import Here, database
from manifests import KUBERNETES, SECRET, services, written
from service_processes import REQUEST, assert_bit_identical, client_of, serial_run

#: Environment variables that the operator of dask sets in its containers.
OF_THE_OPERATOR = {
    "DASK_WORKER_NAME": "rattle-default-worker-1",
    "DASK_SCHEDULER_ADDRESS": "tcp://rattle-scheduler:8786",
}
MORE = {r"\brattle-scheduler(?=:8786)": "127.0.0.1"}


@pytest.mark.skipif(bool(postgres.missing()), reason=postgres.missing())
def test_a_survey_through_everything(tmp_path: Path) -> None:
    first_key = list(yaml.safe_load_all((KUBERNETES / "base" / "first-key.yaml").read_text()))
    here = Here(tmp_path, services([*written(), *first_key], OF_THE_OPERATOR), MORE)
    assert here.environment("front")["PGPASSWORD"] == here.environment("postgres")["POSTGRES_PASSWORD"] == SECRET
    for name in ("data", "tmp"):
        (tmp_path / name).mkdir()
    with ExitStack() as stack:
        stack.enter_context(database(here))
        stack.enter_context(here.started("scheduler"))
        stack.enter_context(here.started("worker"))
        added = here.run("first-key", *here.words(here.services["first-key"]["command"]))
        assert added.returncode == 0, added.stderr
        stack.enter_context(here.started("front"))
        with client_of(here.front, added.stdout.strip()) as client:
            job = client.submit(REQUEST)
            with job.wait().open() as dataset:
                assert_bit_identical(dataset, serial_run(REQUEST))
        assert list((tmp_path / "data" / "surveys").iterdir())
        assert not (tmp_path / "data" / "jobs.sqlite").exists()
