"""Open the persistent data of a service: its data directory, and its job database there or elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

from gear_rattle.service.database import Database
from gear_rattle.service.jobs.bucket_directory import open_directory
from gear_rattle.service.jobs.directory import DataDirectory
from gear_rattle.service.settings import Settings


@contextmanager
def opened(
    settings: Settings, on_change: Callable[[str], None] = lambda _: None
) -> Iterator[tuple[DataDirectory, Database]]:
    """Yield the data directory and the job database, locked against every other service.

    Parameters
    ----------
    settings : Settings
        Of the service.
    on_change : Callable[[str], None]
        Called with the id of a survey after each commit that added an event to it.

    Yields
    ------
    tuple[DataDirectory, Database]
        Both are closed at the end.

    Raises
    ------
    DataDirectoryError
        One of them cannot be used, another service has locked it, or the database knows another directory than this
        one, whose disk may not be mounted.
    """
    directory = open_directory(settings.data, settings.store)
    inside = settings.database_url is None
    url, require = (directory.database_url, directory.require) if inside else (settings.database_url, None)
    assert url is not None
    with directory.locked(), closing(Database(url, on_change, require=require)) as database:
        if inside or settings.store:  # the database is in the directory, or no store is
            directory.identify()
        else:
            directory.identify(database.directory())
            database.remember_directory(directory.identity)
        yield directory, database
