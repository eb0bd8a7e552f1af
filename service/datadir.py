"""The data directory: the job database, one store per survey, and a lock that keeps a second server out."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from service.errors import DataDirectoryError

TRASH = ".trash-"


class DataDirectory:
    """Where one server keeps everything it must find again.

    Args:
        path: the directory; created by :meth:`locked` if absent.
    """

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()
        self._stores = self.path / "surveys"

    @property
    def database_url(self) -> str:
        return f"sqlite:///{self.path / 'jobs.sqlite'}"

    def store(self, survey_id: str) -> Path:
        """Path of a survey's zarr store, whether it exists or not."""
        return self._stores / f"{survey_id}.zarr"

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the directory. The lock belongs to the process and ends with it, even by SIGKILL.

        Raises:
            DataDirectoryError: the directory cannot be used, or another server holds it.
        """
        try:
            self._stores.mkdir(parents=True, exist_ok=True)
            lock = (self.path / "lock").open("a+")
        except OSError as error:
            raise DataDirectoryError(f"The data directory {self.path} cannot be used: {error}") from error
        with lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise DataDirectoryError(
                    f"Another server uses the data directory {self.path}. Stop it, or give this one another directory."
                ) from error
            self._sweep()
            yield

    def remove_store(self, survey_id: str) -> None:
        """Delete a store. It disappears at once: a crash in the middle leaves no half of it under its name."""
        trash = self._stores / f"{TRASH}{survey_id}"
        try:
            os.rename(self.store(survey_id), trash)
        except FileNotFoundError:
            return
        shutil.rmtree(trash, ignore_errors=True)

    def _sweep(self) -> None:
        for trash in self._stores.glob(f"{TRASH}*"):
            shutil.rmtree(trash, ignore_errors=True)
