"""Lock a job database against a second service, by a locked file beside SQLite or an advisory lock in PostgreSQL."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from filelock import FileLock, Timeout
from sqlalchemy import Engine, event

from gear_rattle.service.database.engine import BUSY_SECONDS, open_engine, shown
from gear_rattle.service.errors import DataDirectoryError

LOCK = 0x6765_6172_7261_7474  # "gearratt", the number of the advisory lock
#: A pool of one connection, which is reopened after it is lost.
WRITER = {"pool_size": 1, "max_overflow": 0, "pool_timeout": BUSY_SECONDS, "pool_pre_ping": True}


class Hold(Protocol):
    """A lock on a job database. It lasts until it is released or the process ends, even by SIGKILL.

    writer: the engine that all writes must use.
    """

    writer: Engine

    def release(self) -> None:
        """Release the lock, so that another service can use the database."""


def hold(engine: Engine) -> Hold:
    """Lock a job database. All writes must use the `writer` of the lock.

    Returns
    -------
    Hold
        The lock, with its writing engine.

    Raises
    ------
    DataDirectoryError
        Another service has locked the database, or its lock file cannot be used.
    """
    return _FileHold(engine) if engine.dialect.name == "sqlite" else _SessionHold(engine)


def _held_by_another(engine: Engine) -> DataDirectoryError:
    return DataDirectoryError(
        f"Another service uses the job database {shown(engine.url)}. Stop it, or give this one another database."
    )


class _FileHold:
    """A lock file beside the SQLite file, because opening and closing the SQLite file would release SQLite's locks."""

    def __init__(self, engine: Engine) -> None:
        with engine.connect() as connection:
            database = Path(connection.exec_driver_sql("PRAGMA database_list").one()[2]).resolve()
        path = database.with_name(f"{database.name}.lock")
        self.writer = engine
        self._lock = FileLock(path, timeout=0, thread_local=False)
        try:
            self._lock.acquire()
        except Timeout as error:
            raise _held_by_another(engine) from error
        except OSError as error:
            raise DataDirectoryError(f"The lock {path} of the job database cannot be used: {error}") from error

    def release(self) -> None:
        self._lock.release()


class _SessionHold:
    """An advisory lock in PostgreSQL, which belongs to the only session that writes.

    If the session is lost, so is the lock. The next write opens another session, which locks again or fails.
    """

    def __init__(self, engine: Engine) -> None:
        self.writer = open_engine(engine.url, WRITER)

        @event.listens_for(self.writer, "connect")
        def lock(connection: Any, _: Any) -> None:
            is_free = connection.execute(f"SELECT pg_try_advisory_lock({LOCK})").fetchone()[0]
            connection.rollback()  # ends the transaction; the lock belongs to the session
            if not is_free:
                connection.close()
                raise _held_by_another(engine)

        self.writer.connect().close()

    def release(self) -> None:
        @event.listens_for(self.writer, "close")
        def unlock(connection: Any, _: Any) -> None:
            # The server ends a closed session only a moment later, and until then it would refuse the next service.
            if not connection.broken:
                connection.execute(f"SELECT pg_advisory_unlock({LOCK})")

        self.writer.dispose()
