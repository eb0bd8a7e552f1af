"""Job databases of every age are opened without loss; what is not ours is refused and left as it is."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.operations import Operations
from sqlalchemy import Engine, inspect

from service.database import Database, DoneTile, NewJob
from service.database.engine import UNPOOLED, open_engine
from service.database.tables import Scope, State, Table
from service.errors import DataDirectoryError

#: Verbatim, what `create_all` made of the tables before there were migrations.
TYPES = {
    "sqlite": {"serial": "INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT", "double": "DOUBLE"},
    "postgresql": {"serial": "SERIAL NOT NULL PRIMARY KEY", "double": "DOUBLE PRECISION"},
}
UNVERSIONED = """
CREATE TABLE jobs (
    number {serial}, id VARCHAR NOT NULL, name VARCHAR NOT NULL, state VARCHAR NOT NULL, message VARCHAR NOT NULL,
    request JSON NOT NULL, content_hash VARCHAR NOT NULL, idempotency_key VARCHAR, body_hash VARCHAR NOT NULL,
    n_cells INTEGER NOT NULL, n_tiles INTEGER NOT NULL, cells_done INTEGER NOT NULL, tiles_done INTEGER NOT NULL,
    cells_failed INTEGER NOT NULL, last_event INTEGER NOT NULL, created VARCHAR NOT NULL, started VARCHAR,
    finished VARCHAR, UNIQUE (id), UNIQUE (idempotency_key)
);
CREATE INDEX ix_jobs_state ON jobs (state);
CREATE TABLE events (
    job INTEGER NOT NULL, id INTEGER NOT NULL, kind VARCHAR NOT NULL, data JSON NOT NULL, at VARCHAR NOT NULL,
    PRIMARY KEY (job, id), FOREIGN KEY(job) REFERENCES jobs (number) ON DELETE CASCADE
);
CREATE TABLE tiles (
    job INTEGER NOT NULL, "index" INTEGER NOT NULL, cells INTEGER NOT NULL, seconds {double} NOT NULL,
    failed INTEGER NOT NULL, failures JSON NOT NULL,
    PRIMARY KEY (job, "index"), FOREIGN KEY(job) REFERENCES jobs (number) ON DELETE CASCADE
);
INSERT INTO jobs (id, name, state, message, request, content_hash, idempotency_key, body_hash, n_cells, n_tiles,
                  cells_done, tiles_done, cells_failed, last_event, created)
VALUES ('ended', 'δ', 'failed', 'why', '{{"beta": 0.6}}', 'c', NULL, 'b', 8, 2, 8, 2, 1, 1, 'then'),
       ('waits', '', 'accepted', '', '{{}}', 'c', 'once', 'b', 8, 2, 0, 0, 0, 1, 'then');
INSERT INTO events VALUES (1, 1, 'state', '{{"state": "failed"}}', 'then'), (2, 1, 'state', '{{}}', 'then');
INSERT INTO tiles VALUES (1, 0, 4, 0.5, 0, '[]'), (1, 1, 4, 0.5, 1, '[{{"message": "no"}}]')
"""


@pytest.fixture
def engine(database_url: str) -> Iterator[Engine]:
    engine = open_engine(database_url, UNPOOLED)
    yield engine
    engine.dispose()


def run(engine: Engine, script: str) -> None:
    with engine.execution_options(writes=True).begin() as connection:
        for statement in script.format(**TYPES[engine.dialect.name]).split(";"):
            connection.exec_driver_sql(statement)


def contents(engine: Engine) -> dict[str, list[str]]:
    """Every table with its columns and rows."""
    with engine.connect() as connection:
        present = inspect(connection)
        return {
            name: [str(present.get_columns(name)), *map(str, connection.exec_driver_sql(f"SELECT * FROM {name}"))]
            for name in sorted(present.get_table_names())
        }


def test_models_and_migrations_agree(database_url: str, engine: Engine) -> None:
    Database(database_url).close()
    with engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Table.metadata) == []
        if engine.dialect.name == "sqlite":
            assert connection.exec_driver_sql("PRAGMA journal_mode").scalar_one() == "wal"
            assert connection.exec_driver_sql("PRAGMA synchronous").scalar_one() == 2  # FULL
            assert connection.exec_driver_sql("PRAGMA foreign_keys").scalar_one() == 1


def test_a_database_from_before_migrations_keeps_its_surveys(database_url: str, engine: Engine) -> None:
    run(engine, UNVERSIONED)
    for _ in range(2):  # the second time it is current already
        database = Database(database_url)
        surveys, count = database.jobs(10)
        assert ([job.id for job in surveys], count) == (["waits", "ended"], 2)
        ended = database.job("ended")
        assert (ended.name, ended.message, ended.request, ended.owner) == ("δ", "why", {"beta": 0.6}, None)
        assert database.tiles_done("ended") == {0, 1}
        assert database.failures("ended", 5) == [{"message": "no"}]
        assert [event.data for event in database.events("ended", 0)] == [{"state": "failed"}]
        assert [each.id for each in database.active()] == ["waits"]
        database.close()
    with engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Table.metadata) == []
    database = Database(database_url)
    new = NewJob("", {}, "c", "b", 8, 2, "once")
    assert database.accept(new, 2).id == "waits"
    database.add_tile("waits", DoneTile(0, 4, 0.5, 0, []))
    assert database.set_state("waits", State.DISMISSED)
    database.delete("ended")
    assert database.accept(NewJob("", {}, "c", "b", 8, 2), 2).number == 3
    assert database.jobs(10)[1] == 2
    database.close()


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("CREATE TABLE jobs (number INTEGER, salary REAL); INSERT INTO jobs VALUES (1, 2.5)", "another program"),
        ("CREATE TABLE bookmarks (url VARCHAR); INSERT INTO bookmarks VALUES ('mine')", "another program"),
        ("CREATE TABLE alembic_version (version_num VARCHAR(32)); INSERT INTO alembic_version VALUES ('a1')", "newer"),
        (f"{UNVERSIONED}; ALTER TABLE jobs ADD COLUMN colour VARCHAR", "another program"),
    ],
)
def test_a_foreign_database_is_refused_and_left_alone(
    database_url: str, engine: Engine, script: str, words: str, tmp_path: Path
) -> None:
    run(engine, script)
    before = contents(engine)
    file = tmp_path / "database" / "jobs.sqlite"
    frozen = file.read_bytes() if file.exists() else b""
    for exclusive in (True, False):
        with pytest.raises(DataDirectoryError, match=words):
            Database(database_url, exclusive=exclusive)
    assert contents(engine) == before
    assert not file.exists() or file.read_bytes() == frozen


def test_a_newer_database_is_refused_and_left_alone(database_url: str, engine: Engine) -> None:
    Database(database_url).close()
    run(engine, "UPDATE alembic_version SET version_num = '9999'; ALTER TABLE keys ADD COLUMN colour VARCHAR")
    before = contents(engine)
    with pytest.raises(DataDirectoryError, match="newer version"):
        Database(database_url)
    assert contents(engine) == before


def test_a_migration_that_fails_leaves_nothing_behind(
    database_url: str, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(engine, UNVERSIONED)
    before = contents(engine)

    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("the power failed")

    with monkeypatch.context() as patch:
        patch.setattr(Operations, "execute", fail)  # the last step of the last revision
        with pytest.raises(RuntimeError, match="power"):
            Database(database_url)
    assert contents(engine) == before
    Database(database_url).close()
    assert {"keys", "service"} <= contents(engine).keys()


def test_a_password_is_never_shown() -> None:
    for url in ("postgresql://me:secret@127.0.0.1:1/jobs", "mysql://me:secret@127.0.0.1/jobs"):
        with pytest.raises(DataDirectoryError) as refused:
            Database(url)
        assert "secret" not in str(refused.value)


@pytest.mark.parametrize("url", ["sqlite://", "sqlite:///:memory:", "mysql://localhost/jobs"])
def test_a_database_that_would_not_last_is_refused(url: str) -> None:
    with pytest.raises(DataDirectoryError, match="would not last"):
        Database(url)


def test_keys_are_found_by_hash_until_they_are_revoked(database_url: str) -> None:
    database = Database(database_url)
    tool = Database(database_url, exclusive=False)  # beside a running service
    key = tool.add_key("lab", "hash", {Scope.SUBMIT, Scope.READ}, max_cells=100, max_running=1)
    other = tool.add_key("lab", "other", [Scope.READ])
    tool.close()
    found = database.key_by_hash("hash")
    assert found is not None
    assert (found.id, found.scopes, found.max_cells, found.max_running) == (key.id, ["read", "submit"], 100, 1)
    every = database.keys()
    assert {row.id for row in every} == {key.id, other.id}
    first = database.revoke_key(key.id).revoked
    assert first is not None
    assert database.revoke_key(key.id).revoked == first
    assert database.key_by_hash("hash") is None
    assert database.key_by_hash("other") is not None
    every = database.keys()
    assert [row.revoked for row in every if row.id == key.id] == [first]
    database.close()
