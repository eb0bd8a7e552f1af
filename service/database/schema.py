"""The schema of the job database: upgrade older schemas, and refuse databases of other programs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqlalchemy import Connection, Engine, Inspector, inspect

from gear_rattle.service.database.engine import url_without_password
from gear_rattle.service.database.tables import TableBase
from gear_rattle.service.errors import DataDirectoryError

if TYPE_CHECKING:
    from alembic.config import Config

VERSION_TABLE = "alembic_version"

#: Names of the columns of each table in this version's schema.
_COLUMNS = {name: set(table.columns.keys()) for name, table in TableBase.metadata.tables.items()}


def has_current_schema(engine: Engine) -> bool:
    """Return whether the database has the schema of this version. The database is not changed.

    Returns
    -------
    bool
        False for an empty database, and for an older schema that can be upgraded.

    Raises
    ------
    DataDirectoryError
        The database belongs to another program or to a newer version, or its encoding is not UTF-8.
    """
    from alembic.runtime.migration import MigrationContext
    from alembic.script import ScriptDirectory

    with engine.connect() as connection:
        _require_utf8(connection)
        present = inspect(connection)
        tables = set(present.get_table_names())
        revision = MigrationContext.configure(connection).get_current_revision() if VERSION_TABLE in tables else None
        scripts = ScriptDirectory.from_config(_alembic_config())
        head = scripts.get_current_head()
        if revision is None:
            if tables - {VERSION_TABLE}:
                refusal = _foreign_database_error(engine, "another program")
                raise refusal
        elif revision not in {script.revision for script in scripts.walk_revisions()}:
            refusal = _foreign_database_error(
                engine, f"a newer version, or another program (its schema is {revision!r}, this version's is {head!r})"
            )
            raise refusal
        elif revision == head and not _has_tables(present, _COLUMNS):
            refusal = _foreign_database_error(engine, "another program, or has been changed by hand")
            raise refusal
        return revision == head


def upgrade_schema(engine: Engine) -> None:
    """Upgrade schema and data in one transaction; set WAL mode in SQLite. The caller must have locked the database."""
    from alembic import command

    if engine.dialect.name == "sqlite":
        # SQLite stores WAL mode in the database file. Another program's file must not be changed, so the caller has
        # checked with `has_current_schema` that the file belongs to no other program.
        with engine.connect() as connection:
            connection.exec_driver_sql("COMMIT")
            connection.exec_driver_sql("PRAGMA journal_mode=WAL")
            connection.exec_driver_sql("BEGIN")
    if has_current_schema(engine):
        return
    with engine.execution_options(writes=True).begin() as connection:
        config = _alembic_config()
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


def _alembic_config() -> Config:
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", "gear_rattle.service:migrations")
    return config


def _has_tables(present: Inspector, expected: dict[str, set[str]]) -> bool:
    return all(
        present.has_table(table) and {column["name"] for column in present.get_columns(table)} == columns
        for table, columns in expected.items()
    )


def _require_utf8(connection: Connection) -> None:
    if connection.dialect.name == "postgresql":
        encoding = connection.exec_driver_sql("SHOW server_encoding").scalar_one()
        if encoding != "UTF8":
            raise DataDirectoryError(f"The job database has the encoding {encoding}. Create it with ENCODING 'UTF8'.")


def _foreign_database_error(engine: Engine, made_by: str) -> DataDirectoryError:
    """Return the error for a job database of another program or version.

    made_by: words for the message "… belongs to {made_by}", such as "another program".

    Returns
    -------
    DataDirectoryError
        The error, with advice.
    """
    return DataDirectoryError(
        f"The job database {url_without_password(engine.url)} belongs to {made_by}. "
        "Give this service a database of its own, or use the version that made this database."
    )
