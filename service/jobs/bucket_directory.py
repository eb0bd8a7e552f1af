"""A data directory whose stores are in a bucket. The lock and usually the job database are on a local disk."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

from gear_rattle.service.jobs.directory import SURVEY_STORE, DataDirectory, StoreEntry
from gear_rattle.workers import StoreInBucket


class BucketDirectory(DataDirectory):
    """The data directory of a service whose stores are in a bucket, under a prefix.

    Parameters
    ----------
    path
        The data directory.
    url
        ``s3://BUCKET/PREFIX``, a prefix that no other service uses.
    """

    def __init__(self, path: Path, url: str) -> None:
        super().__init__(path)
        self._root = StoreInBucket(url)
        self._bucket = lru_cache(maxsize=256)(self._open_bucket)

    def _open_bucket(self, survey_id: str) -> StoreInBucket:
        # owned: no other process writes to this store, because the service has locked its job database.
        return StoreInBucket(f"{self._root}/{survey_id}.zarr", owned=True)

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Lock the directory during this context. If the bucket cannot be reached, raise StorageError at once."""
        with super().lock():
            self._root.children()  # raises an error if the bucket is missing
            yield

    def store(self, survey_id: str) -> StoreInBucket:
        """Return the store of a survey in the bucket, whether the store exists or not."""
        return self._bucket(survey_id)

    def remove_store(self, survey_id: str) -> None:
        """Delete the store of a survey."""
        self.store(survey_id).delete()

    def entries(self) -> list[StoreEntry]:
        """Return the entries below the prefix in the bucket, sorted by name."""
        return sorted(self._iterate_entries(), key=lambda entry: entry.name)

    def _iterate_entries(self) -> Iterator[StoreEntry]:
        for name in self._root.children():
            if match := SURVEY_STORE.fullmatch(name):
                store = self.store(match["survey"])
                yield StoreEntry(
                    f"{self._root}/{name}", match["survey"], store.has_deletion_begun(), False, store.delete
                )
            else:
                yield StoreEntry(f"{self._root}/{name}", "", False, False, lambda: None)

    def remove_partial_files(self, survey_id: str, content_hash: str) -> None:
        """Do nothing, because a bucket has no partial objects."""


def data_directory_with_stores(path: Path, stores: str | None) -> DataDirectory:
    """Return the data directory of a service. stores: URL of a bucket, or None for stores in the directory."""
    return BucketDirectory(path, stores) if stores else DataDirectory(path)
