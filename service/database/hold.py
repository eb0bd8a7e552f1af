"""Keeps a second service off a job database, whatever its data directory."""

from __future__ import annotations

import fcntl
import logging
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Protocol

from sqlalchemy import Connection, Engine
from sqlalchemy.exc import SQLAlchemyError

from service.database.engine import UNPOOLED, open_engine, shown
from service.errors import DataDirectoryError

LOCK = 0x6765_6172_7261_7474  # "gearratt", the number of the advisory lock
LOOK_SECONDS, AGAIN_SECONDS = 2.0, 0.5

log = logging.getLogger(__name__)


class Hold(Protocol):
    """A job database that is held until it is released or the process ends, even by SIGKILL."""

    def release(self) -> None:
        """Let others have it."""


def hold(engine: Engine, is_ours: Callable[[], bool]) -> Hold:
    """Take a job database.

    Args:
        engine: of the database.
        is_ours: whether no other service has been there since; asked when a lost lock was taken again.

    Raises:
        DataDirectoryError: another service holds it.
    """
    return FileHold(engine) if engine.dialect.name == "sqlite" else SessionHold(engine, is_ours)


def _held_by_another(engine: Engine) -> DataDirectoryError:
    return DataDirectoryError(
        f"Another service uses the job database {shown(engine.url)}. Stop it, or give this one another database."
    )


class FileHold:
    """A lock on a file beside the SQLite file. Not on that file: closing it would drop SQLite's own locks."""

    def __init__(self, engine: Engine) -> None:
        with engine.connect() as connection:
            database = Path(connection.exec_driver_sql("PRAGMA database_list").one()[2]).resolve()
        path = database.with_name(f"{database.name}.lock")
        with ExitStack() as stack:
            try:
                lock = stack.enter_context(path.open("a+"))
            except OSError as error:
                raise DataDirectoryError(f"The lock {path} of the job database cannot be used: {error}") from error
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise _held_by_another(engine) from error
            self._stack = stack.pop_all()

    def release(self) -> None:
        self._stack.close()


class SessionHold:
    """An advisory lock of a PostgreSQL session of its own.

    The lock is lost with its connection, so a thread looks after it and takes the lock again. What is written does not
    depend on that: the epoch in the database tells every write whether another service has been there since.
    """

    def __init__(self, engine: Engine, is_ours: Callable[[], bool]) -> None:
        self._shown = shown(engine.url)
        self._is_ours = is_ours
        self._engine = open_engine(engine.url, UNPOOLED).execution_options(isolation_level="AUTOCOMMIT")
        self._connection: Connection | None = None
        self._released = threading.Event()
        if not self._take():
            raise _held_by_another(engine)
        self._thread = threading.Thread(target=self._look_after, name="database-lock", daemon=True)
        self._thread.start()

    def release(self) -> None:
        self._released.set()
        self._thread.join()
        if self._connection is not None:  # a session that ends lets go a moment later: the next would be refused
            with suppress(SQLAlchemyError):
                self._connection.exec_driver_sql(f"SELECT pg_advisory_unlock({LOCK})")
        self._drop()

    def _take(self) -> bool:
        self._connection = self._engine.connect()
        if self._connection.exec_driver_sql(f"SELECT pg_try_advisory_lock({LOCK})").scalar_one():
            return True
        self._drop()
        return False

    def _drop(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            with suppress(SQLAlchemyError):
                connection.close()

    def _look_after(self) -> None:
        pause = LOOK_SECONDS
        while not self._released.wait(pause):
            pause = LOOK_SECONDS
            try:
                if self._connection is not None:
                    self._connection.exec_driver_sql("SELECT 1")
                elif not self._take():
                    log.error("another service has taken the job database %s", self._shown)
                elif self._is_ours():
                    log.warning("the lock of the job database %s is held again", self._shown)
                else:
                    log.error("another service has used the job database %s: start this one again", self._shown)
                    self._drop()
                    return
            except SQLAlchemyError as error:
                if self._connection is not None:
                    log.warning("the lock of the job database %s is lost: %s", self._shown, error)
                self._drop()
                pause = AGAIN_SECONDS
