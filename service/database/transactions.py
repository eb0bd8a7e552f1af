"""Transactions that read from the job database or write to it: the base class of `Surveys` and `AccessKeys`."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from sqlalchemy import Engine, select
from sqlalchemy.orm import Session

from gear_rattle.service.database.engine import BUSY_SECONDS
from gear_rattle.service.database.tables import ServiceRow
from gear_rattle.service.errors import DataDirectoryError, UnavailableError

DATABASE_TAKEN = (
    "Another service has opened the job database, so this service has stopped writing. "
    "Stop one of the two services, and restart the other."
)


class Transactions:
    """Base class of `Surveys` and `AccessKeys`, with the read and write transactions of one job database.

    Parameters
    ----------
    engine
        The open database.
    on_change
        Called with the id of a survey or population after each commit that added an event to it or changed its texts.
    require
        Called before each transaction; its exceptions are passed on.
    """

    def __init__(
        self, engine: Engine, on_change: Callable[[str], None], require: Callable[[], None] | None = None
    ) -> None:
        self._on_change = on_change
        self._require = require or (lambda: None)
        self._reader = engine
        self._set_writer(engine)
        self._epoch: int | None = None
        self._writing = threading.Lock()

    def _set_writer(self, engine: Engine) -> None:
        """Use this engine for all further writes."""
        self._writer = engine.execution_options(writes=True)

    @contextmanager
    def _begin_read_transaction(self) -> Iterator[Session]:
        """Yield a session for one transaction that only reads."""
        self._require()
        with Session(self._reader, expire_on_commit=False) as session:
            yield session

    @contextmanager
    def _begin_write_transaction(self) -> Iterator[tuple[Session, ServiceRow]]:
        """Yield a transaction that excludes other writers, so that no row that it reads can change before it writes.

        Yields
        ------
        tuple[Session, ServiceRow]
            The session, and the row of the service.

        Raises
        ------
        UnavailableError
            Another service has opened the database after this one, or earlier writers take too long.
        """
        self._require()
        with self._wait_to_write(), Session(self._writer, expire_on_commit=False) as session, session.begin():
            try:
                service = session.scalars(select(ServiceRow).with_for_update()).one()
            except DataDirectoryError as error:  # the lost connection was reopened, but another service has the lock
                raise UnavailableError(DATABASE_TAKEN) from error
            if self._epoch not in (None, service.epoch):
                session.connection().invalidate()  # closes the connection, which releases its locks
                raise UnavailableError(DATABASE_TAKEN)
            yield session, service

    @contextmanager
    def _wait_to_write(self) -> Iterator[None]:
        # Writing threads queue here. In SQLite they would sleep for increasing times, and some would wait for seconds.
        if not self._writing.acquire(timeout=BUSY_SECONDS):
            raise UnavailableError("The job database is busy with other writes. Try again in a few seconds.")
        try:
            yield
        finally:
            self._writing.release()

    def directory_identity(self) -> str | None:
        """Return the identity of the data directory that has the stores; None if no service recorded it."""
        with self._begin_read_transaction() as session:
            return session.scalar(select(ServiceRow.directory))

    def record_directory_identity(self, identity: str) -> None:
        """Record the identity of the data directory that has the stores."""
        with self._begin_write_transaction() as (_, service):
            service.directory = identity
