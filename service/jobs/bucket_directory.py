"""A data directory whose stores are in a bucket; the lock, and the job database unless it is elsewhere, stay local."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

from gear_rattle.service.jobs.directory import SURVEY_STORE, DataDirectory, StoreEntry
from gear_rattle.workers import Bucket


class BucketDirectory(DataDirectory):
    """Directory of a service's jobs, and the prefix of a bucket with its stores.

    Parameters
    ----------
    path
        The data directory.
    url
        ``s3://BUCKET/PREFIX``, of this service alone.
    """

    def __init__(self, path: Path, url: str) -> None:
        super().__init__(path)
        self._root = Bucket(url)
        self._bucket = lru_cache(maxsize=256)(self._open)

    def _open(self, survey_id: str) -> Bucket:
        # A service holds its job database, so nobody else writes to the stores of its surveys.
        return Bucket(f"{self._root}/{survey_id}.zarr", owned=True)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the lock of the directory; raise at once if the bucket is not there."""
        with super().locked():
            self._root.children()  # a bucket that is not there is said now
            yield

    def store(self, survey_id: str) -> Bucket:
        """Return the store of a survey."""
        return self._bucket(survey_id)

    def remove_store(self, survey_id: str) -> None:
        """Delete the store of a survey."""
        self.store(survey_id).delete()

    def entries(self) -> list[StoreEntry]:
        """Return the entries among the stores, by name."""
        return sorted(self._entries(), key=lambda entry: entry.name)

    def _entries(self) -> Iterator[StoreEntry]:
        for name in self._root.children():
            if match := SURVEY_STORE.fullmatch(name):
                store = self.store(match["survey"])
                yield StoreEntry(f"{self._root}/{name}", match["survey"], store.deletion_begun(), False, store.delete)
            else:
                yield StoreEntry(f"{self._root}/{name}", "", False, False, lambda: None)

    def sweep_partial_files(self, survey_id: str, content_hash: str) -> None:
        """Nothing: an object is put whole or not at all."""


def open_directory(path: Path, stores: str | None) -> DataDirectory:
    """Return the data directory of a service, with its stores in it, or at a URL."""
    return BucketDirectory(path, stores) if stores else DataDirectory(path)
