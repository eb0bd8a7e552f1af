"""The job database: the record of all surveys and populations, which outlasts the service and the cluster."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sqlalchemy import URL, event, make_url
from sqlalchemy.exc import SQLAlchemyError

from gear_rattle.service.database.database_lock import DatabaseLock, lock_database
from gear_rattle.service.database.engine import open_engine, url_without_password
from gear_rattle.service.database.identity import NewJob
from gear_rattle.service.database.keys import AccessKeys
from gear_rattle.service.database.schema import has_current_schema, upgrade_schema
from gear_rattle.service.database.survey_rows import DoneTile, Surveys
from gear_rattle.service.errors import DataDirectoryError

__all__ = ["Database", "DoneTile", "NewJob"]


class Database(Surveys, AccessKeys):
    """The surveys and populations, their tiles and events, and the API keys.

    Every method except `close` is one transaction, and may be called from any thread.

    Parameters
    ----------
    url
        SQLAlchemy URL of a SQLite file or of a PostgreSQL database.
    on_change
        Called with the id of a survey or population after each commit that added an event to it or changed its texts.
    exclusive
        Lock the database against other services until it is closed. A short-lived command beside a running service
        passes False; then the database is locked only while its schema is upgraded.
    require
        Called before each transaction; its exceptions are passed on.

    Raises
    ------
    DataDirectoryError
        The database cannot be opened, another service has locked it, or it belongs to another program or to a newer
        version. The database is left unchanged.
    """

    def __init__(
        self,
        url: str | URL,
        on_change: Callable[[str], None] = lambda _: None,
        *,
        exclusive: bool = True,
        require: Callable[[], None] | None = None,
    ) -> None:
        self._lock: DatabaseLock | None = None
        try:
            super().__init__(open_engine(url), on_change, require)
            try:
                self._lock_and_upgrade(exclusive)
            except BaseException:
                self.close()
                raise
        except (SQLAlchemyError, ImportError) as error:
            raise DataDirectoryError(f"The job database {_url_for_message(url)} cannot be opened: {error}") from error

    def close(self) -> None:
        """Release the lock, and close every connection."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None
        # The thread of a cancelled request may still use a connection, which is closed when it returns to the pool.
        event.listen(self._reader, "checkin", _close_returned_connection)
        self._reader.dispose()

    def _lock_and_upgrade(self, exclusive: bool) -> None:
        # This check comes first, because it refuses a database of another program before anything is written.
        current = has_current_schema(self._reader)
        if current and not exclusive:
            return
        self._lock = lock_database(self._reader)
        upgrade_schema(self._reader)
        if exclusive:
            self._set_writer(self._lock.writer)
            with self._begin_write_transaction() as (_, service):
                service.epoch += 1
            self._epoch = service.epoch
        else:
            self._lock.release()
            self._lock = None


def _close_returned_connection(_: Any, record: Any) -> None:
    record.invalidate()


def _url_for_message(url: str | URL) -> str:
    try:
        return url_without_password(make_url(url))
    except SQLAlchemyError:  # the text is no URL; it is not shown, because it may contain a password
        return "of the settings"
