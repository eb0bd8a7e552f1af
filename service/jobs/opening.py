"""Open the persistent data of a service: its data directory and its job database."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

from gear_rattle.service.database import Database
from gear_rattle.service.jobs.bucket_directory import data_directory_with_stores
from gear_rattle.service.jobs.directory import DataDirectory
from gear_rattle.service.settings import Settings


@contextmanager
def open_service_data(
    settings: Settings, on_change: Callable[[str], None] = lambda _: None
) -> Iterator[tuple[DataDirectory, Database]]:
    """Yield the data directory and the job database, locked against other services.

    Parameters
    ----------
    settings : Settings
        The settings of the service.
    on_change : Callable[[str], None]
        Called with the id of a survey or population after each commit that added an event to it, or changed its name
        or notes.

    Yields
    ------
    tuple[DataDirectory, Database]
        The open directory and database, which are closed at the end of the context.

    Raises
    ------
    DataDirectoryError
        The directory or the database cannot be used, or another service has locked one of them, or the database belongs
        to another directory, whose disk may not be mounted.
    """
    directory = data_directory_with_stores(settings.data, settings.store)
    inside = settings.database_url is None
    url, require = (directory.database_url, directory.require_present) if inside else (settings.database_url, None)
    assert url is not None
    with directory.lock(), closing(Database(url, on_change, require=require)) as database:
        if inside or settings.store:
            directory.check_identity()
        else:  # with a wrong disk at the data directory, its stores would not belong to this database
            directory.check_identity(database.directory_identity())
            database.record_directory_identity(directory.identity)
        yield directory, database
