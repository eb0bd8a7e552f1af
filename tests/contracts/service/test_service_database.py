"""Many threads, or two services, on one job database: what was promised to each of them holds."""

import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from postgres import Postgres
from sqlalchemy import select, text
from sqlalchemy.exc import SQLAlchemyError
from waiting import HANG

from gear_rattle.service.database import Database, DoneTile, NewJob
from gear_rattle.service.database.database_lock import ADVISORY_LOCK
from gear_rattle.service.database.engine import UNPOOLED, open_engine
from gear_rattle.service.database.identity import MOST_REPEATED_KEYS
from gear_rattle.service.database.tables import RepeatedKeyRow, Scope, State
from gear_rattle.service.errors import (
    ConflictError,
    DataDirectoryError,
    QueueFullError,
    UnavailableError,
    UnknownSurveyError,
)

THREADS = 12


def new(key: str | None = None, body: str = "b", owner: str | None = None, tiles: int = 4) -> NewJob:
    return NewJob("", {}, "c", body, 6 * tiles, tiles, key, owner)


@pytest.fixture
def database(database_url: str) -> Iterator[Database]:
    database = Database(database_url)
    yield database
    database.close()


def outcomes(call: Any, arguments: Any) -> list[Any]:
    """Results or exceptions of calls that are made at the same time."""

    def attempt(argument: Any) -> Any:
        try:
            return call(argument)
        except (ConflictError, QueueFullError, UnknownSurveyError) as error:
            return error

    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(attempt, arguments))


def kinds(found: list[Any]) -> dict[str, int]:
    names = [type(item).__name__ for item in found]
    return {name: names.count(name) for name in names}


def test_a_connection_that_a_thread_gives_back_after_the_close_is_closed(database_url: str) -> None:
    """Such a thread serves a stream that ended while it still read."""
    database = Database(database_url)
    with database._begin_read_transaction() as session:
        session.execute(text("SELECT 1"))
        connection = session.connection().connection.dbapi_connection
        database.close()
        assert session.execute(text("SELECT 1")).scalar_one() == 1  # to its end
    with pytest.raises(Exception, match="closed"):
        connection.cursor().execute("SELECT 1")


def test_one_key_is_one_survey_for_any_number_of_threads(database: Database) -> None:
    found = outcomes(lambda _: database.add_or_find_job(new("once"), 100).id, range(3 * THREADS))
    assert len(set(found)) == 1
    bodies = outcomes(
        lambda number: database.add_or_find_job(new("twice", f"body {number % 2}"), 100), range(2 * THREADS)
    )
    assert kinds(bodies) == {"JobRow": THREADS, "ConflictError": THREADS}
    assert database.jobs(10)[1] == 2


def test_the_latest_answers_are_remembered(database: Database) -> None:
    first = database.add_or_find_job(new("first"), 100)
    for number in range(MOST_REPEATED_KEYS + 10):
        assert database.add_or_find_job(new(f"again {number}"), 100, lambda _: True).id == first.id
    with database._begin_read_transaction() as session:
        kept = set(session.scalars(select(RepeatedKeyRow.idempotency_key)))
    assert len(kept) == MOST_REPEATED_KEYS
    assert f"again {MOST_REPEATED_KEYS + 9}" in kept
    assert database.add_or_find_job(new("first"), 100).id == first.id  # its own is in its row
    with pytest.raises(ConflictError):
        database.add_or_find_job(new(f"again {MOST_REPEATED_KEYS + 9}", "other"), 100)


def test_the_queue_never_holds_more_than_it_may(database: Database) -> None:
    found = outcomes(lambda _: database.add_or_find_job(new(), 5), range(3 * THREADS))
    assert kinds(found) == {"JobRow": 5, "QueueFullError": 3 * THREADS - 5}
    assert database.count_jobs(State.ACCEPTED) == database.jobs(10)[1] == 5


def test_an_owner_has_its_own_quota_and_idempotency_keys(database: Database) -> None:
    first = database.add_key("first", "1", [Scope.SUBMIT], max_running=2).id
    second = database.add_key("second", "2", [Scope.SUBMIT]).id
    found = outcomes(lambda _: database.add_or_find_job(new(owner=first), 100), range(2 * THREADS))
    assert kinds(found) == {"JobRow": 2, "QueueFullError": 2 * THREADS - 2}
    assert "of your key" in str(next(item for item in found if isinstance(item, QueueFullError)))
    others = {database.add_or_find_job(new("same", body=str(owner), owner=owner), 100).id for owner in (second, None)}
    assert len(others) == 2
    ended = next(item for item in found if not isinstance(item, QueueFullError))
    assert ended.owner == first
    database.set_state(ended.id, State.DISMISSED)
    assert database.add_or_find_job(new("same", owner=first), 100).id not in others


def test_tiles_and_a_dismissal_at_once_leave_true_counts(database: Database) -> None:
    for _ in range(4):
        survey_id = database.add_or_find_job(new(tiles=40), 100).id
        database.set_state(survey_id, State.RUNNING)

        def act(number: int, survey_id: str = survey_id) -> None:
            if number == 20:
                database.set_state(survey_id, State.DISMISSED)
            else:
                database.add_tile(survey_id, DoneTile(number, 6, 0.1, number % 2, [{"message": "no"}] * (number % 2)))

        outcomes(act, range(40))
        job, tiles = database.job(survey_id), database.recorded_tile_indices(survey_id)
        events = database.events(survey_id, 0)
        assert job.state == State.DISMISSED
        assert (job.tiles_done, job.cells_done) == (len(tiles), 6 * len(tiles))
        assert job.cells_failed == len([tile for tile in tiles if tile % 2]) == len(database.failures(survey_id, 100))
        assert [event.id for event in events] == list(range(1, job.last_event + 1))
        assert events[-1].data["state"] == "dismissed"
        assert [event.data["tiles_done"] for event in events if event.kind == "tile"] == list(range(1, len(tiles) + 1))


def test_a_survey_is_deleted_once_and_ends_once(database: Database) -> None:
    survey_id = database.add_or_find_job(new(), 100).id
    ends = [State.SUCCESSFUL, State.FAILED, State.DISMISSED] * 4
    assert outcomes(lambda state: database.set_state(survey_id, state), ends).count(True) == 1
    assert [event.kind for event in database.events(survey_id, 0)] == ["state", "state"]
    found = outcomes(lambda _: database.delete(survey_id), range(THREADS))
    assert kinds(found) == {"NoneType": 1, "UnknownSurveyError": THREADS - 1}
    assert database.jobs(10) == ([], 0)


def test_text_that_a_database_cannot_hold_neither_fails_nor_matches(database: Database) -> None:
    survey_id = database.add_or_find_job(new(), 100).id
    database.add_tile(survey_id, DoneTile(0, 6, 0.1, 1, [{"message": "a\0b\ud800"}]))
    assert database.failures(survey_id, 1) == [{"message": "a\0b\ud800"}]
    database.set_state(survey_id, State.FAILED, "a\0b\ud800 δ")
    assert database.job(survey_id).message == "a\ufffdb? δ"
    for call in (database.job, database.recorded_tile_indices, database.delete, lambda text: database.events(text, 0)):
        with pytest.raises(UnknownSurveyError):
            call(f"{survey_id}\0")


@pytest.mark.parametrize("encoding", ["SQL_ASCII", "LATIN1"])
def test_a_database_that_cannot_hold_every_text_is_refused(postgres: Postgres, encoding: str) -> None:
    url = postgres.create(encoding)
    try:
        with pytest.raises(DataDirectoryError, match=f"has the encoding {encoding}. Create it with ENCODING 'UTF8'"):
            Database(url)
    finally:
        postgres.drop(url)


def test_a_second_service_is_refused_until_the_first_is_gone(database_url: str) -> None:
    first = Database(database_url)
    with pytest.raises(DataDirectoryError, match="Another service uses the job database"):
        Database(database_url)
    first.add_or_find_job(new(), 1)  # a refused one takes nothing away
    first.close()
    second = Database(database_url)
    with pytest.raises(DataDirectoryError, match="Another service"):
        Database(database_url)
    second.close()


def test_one_sqlite_file_by_two_names_is_one_database(tmp_path: Path) -> None:
    database = Database(f"sqlite:///{tmp_path}/jobs.sqlite")
    (tmp_path / "link").symlink_to("jobs.sqlite")
    with pytest.raises(DataDirectoryError, match="Another service uses the job database"):
        Database(f"sqlite:///{tmp_path}/link")
    database.close()


def test_a_service_whose_database_was_taken_writes_no_more(database_url: str) -> None:
    database = Database(database_url)
    survey_id = database.add_or_find_job(new(), 1).id
    with open_engine(database_url, UNPOOLED).execution_options(writes=True).begin() as connection:
        connection.execute(text("UPDATE service SET epoch = epoch + 1"))  # what another one does first
    for write in (
        lambda: database.add_or_find_job(new(), 9),
        lambda: database.set_state(survey_id, State.RUNNING),
        lambda: database.add_tile(survey_id, DoneTile(0, 6, 0.1, 0, [])),
        lambda: database.keep_only_tiles(survey_id, set()),
    ):
        with pytest.raises(UnavailableError, match="Another service"):
            write()
    assert database.job(survey_id).state == State.ACCEPTED
    database.close()


def holders(url: str) -> list[int]:
    """Process ids of the sessions that hold the lock of a job database."""
    held = f"""SELECT pid FROM pg_locks WHERE locktype = 'advisory' AND granted AND classid = {ADVISORY_LOCK >> 32}
        AND objid = {ADVISORY_LOCK & 0xFFFFFFFF}
        AND database = (SELECT oid FROM pg_database WHERE datname = current_database())"""
    with open_engine(url, UNPOOLED).connect() as connection:
        return list(connection.execute(text(held)).scalars())


def kill_session(url: str, pid: int) -> None:
    with open_engine(url, UNPOOLED).connect() as connection:
        connection.execute(text(f"SELECT pg_terminate_backend({pid}, {HANG * 1000:.0f})"))


def test_a_lost_lock_is_taken_again_by_the_next_write(postgres_url: str) -> None:
    database = Database(postgres_url)
    (pid,) = holders(postgres_url)
    kill_session(postgres_url, pid)
    survey_id = database.add_or_find_job(new(), 1).id  # nobody else came: this service may go on
    (again,) = holders(postgres_url)
    assert again != pid
    with pytest.raises(DataDirectoryError, match="Another service"):
        Database(postgres_url)
    database.set_state(survey_id, State.RUNNING)
    database.close()
    assert holders(postgres_url) == []


def test_a_lock_that_another_service_took_is_not_taken_back(postgres_url: str) -> None:
    first = Database(postgres_url)
    kill_session(postgres_url, holders(postgres_url)[0])
    second = Database(postgres_url)
    with pytest.raises(UnavailableError, match="Another service"):
        first.add_or_find_job(new(), 9)
    assert second.add_or_find_job(new(), 9).number == 1
    second.close()
    with pytest.raises(UnavailableError, match="Another service"):
        first.add_or_find_job(new(), 9)
    assert holders(postgres_url) == []  # the first one leaves the database to the next service that starts
    Database(postgres_url).close()
    first.close()


def test_a_crash_of_the_database_server_loses_nothing_that_was_committed(postgres: Postgres, postgres_url: str) -> None:
    database = Database(postgres_url)
    survey_id = database.add_or_find_job(new(), 1).id
    database.add_tile(survey_id, DoneTile(0, 6, 0.1, 0, []))
    postgres.stop(signal.SIGQUIT)
    try:
        for call in (
            database.job,
            database.recorded_tile_indices,
            lambda name: database.set_state(name, State.RUNNING),
        ):
            with pytest.raises(SQLAlchemyError):
                call(survey_id)
    finally:
        postgres.start()
    assert database.recorded_tile_indices(survey_id) == {0}
    assert database.set_state(survey_id, State.RUNNING)
    assert holders(postgres_url)
    database.close()
