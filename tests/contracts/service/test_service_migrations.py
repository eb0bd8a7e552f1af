"""A job database is made whole or not at all; the database of another program or version is refused and left alone."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.operations import Operations
from sqlalchemy import Engine, inspect

from gear_rattle.service.database import Database
from gear_rattle.service.database.engine import UNPOOLED, open_engine
from gear_rattle.service.database.tables import Scope, TableBase
from gear_rattle.service.errors import DataDirectoryError


@pytest.fixture
def engine(database_url: str) -> Iterator[Engine]:
    engine = open_engine(database_url, UNPOOLED)
    yield engine
    engine.dispose()


def run(engine: Engine, script: str) -> None:
    with engine.execution_options(writes=True).begin() as connection:
        for statement in script.split(";"):
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
        assert compare_metadata(MigrationContext.configure(connection), TableBase.metadata) == []
        if engine.dialect.name == "sqlite":
            assert connection.exec_driver_sql("PRAGMA journal_mode").scalar_one() == "wal"
            assert connection.exec_driver_sql("PRAGMA synchronous").scalar_one() == 2  # FULL
            assert connection.exec_driver_sql("PRAGMA foreign_keys").scalar_one() == 1


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("CREATE TABLE jobs (number INTEGER, salary REAL); INSERT INTO jobs VALUES (1, 2.5)", "another program"),
        ("CREATE TABLE bookmarks (url VARCHAR); INSERT INTO bookmarks VALUES ('mine')", "another program"),
        ("CREATE TABLE alembic_version (version_num VARCHAR(32)); INSERT INTO alembic_version VALUES ('a1')", "newer"),
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
    with pytest.raises(DataDirectoryError, match="neither a SQLite file nor a PostgreSQL database"):
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
