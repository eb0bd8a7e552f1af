"""Lock a job database against a second service, by a locked file beside SQLite or an advisory lock in PostgreSQL."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from filelock import FileLock, Timeout
from sqlalchemy import Engine, event

from gear_rattle.service.database.engine import BUSY_SECONDS, open_engine, url_without_password
from gear_rattle.service.errors import DataDirectoryError

ADVISORY_LOCK = 0x6765_6172_7261_7474  # number of the advisory lock in PostgreSQL: "gearratt" in ASCII
#: Options of a pool of one connection, which is reopened after it is lost.
WRITER_POOL = {"pool_size": 1, "max_overflow": 0, "pool_timeout": BUSY_SECONDS, "pool_pre_ping": True}


class DatabaseLock(Protocol):
    """A lock on a job database. The lock lasts until it is released or the process ends, even by SIGKILL.

    writer: the engine that all writes to the database must use.
    """

    writer: Engine

    def release(self) -> None:
        """Release the lock, so that another service can use the database."""


def lock_database(engine: Engine) -> DatabaseLock:
    """Lock a job database. Afterwards all writes must use the engine `writer` of the lock.

    Returns
    -------
    DatabaseLock
        The lock, with its writing engine.

    Raises
    ------
    DataDirectoryError
        Another service has locked the database, or its lock file cannot be used.
    """
    return _FileLock(engine) if engine.dialect.name == "sqlite" else _AdvisoryLock(engine)


def _locked_elsewhere_error(engine: Engine) -> DataDirectoryError:
    return DataDirectoryError(
        f"Another service uses the job database {url_without_password(engine.url)}. Stop that service, or give this "
        "one another database."
    )


class _FileLock:
    """A locked file beside the SQLite file.

    A lock of the SQLite file itself would not last: a process loses it when any of its connections closes that file.
    """

    def __init__(self, engine: Engine) -> None:
        with engine.connect() as connection:
            database = Path(connection.exec_driver_sql("PRAGMA database_list").one()[2]).resolve()
        path = database.with_name(f"{database.name}.lock")
        self.writer = engine
        self._lock = FileLock(path, timeout=0, thread_local=False)
        try:
            self._lock.acquire()
        except Timeout as error:
            raise _locked_elsewhere_error(engine) from error
        except OSError as error:
            raise DataDirectoryError(f"The lock file {path} of the job database cannot be used: {error}") from error

    def release(self) -> None:
        self._lock.release()


class _AdvisoryLock:
    """An advisory lock in PostgreSQL, which belongs to the only session that writes.

    If the session is lost, so is the lock. The next write opens another session, which locks the database again or
    raises DataDirectoryError.
    """

    def __init__(self, engine: Engine) -> None:
        self.writer = open_engine(engine.url, WRITER_POOL)

        @event.listens_for(self.writer, "connect")
        def lock(connection: Any, _: Any) -> None:
            is_free = connection.execute(f"SELECT pg_try_advisory_lock({ADVISORY_LOCK})").fetchone()[0]
            connection.rollback()  # ends the transaction; the lock belongs to the session
            if not is_free:
                connection.close()
                raise _locked_elsewhere_error(engine)

        self.writer.connect().close()

    def release(self) -> None:
        @event.listens_for(self.writer, "close")
        def unlock(connection: Any, _: Any) -> None:
            # Without this statement, the server would hold the lock until it ends the closed session, a moment later.
            # Until then the next service could not start.
            if not connection.broken:
                connection.execute(f"SELECT pg_advisory_unlock({ADVISORY_LOCK})")

        self.writer.dispose()
