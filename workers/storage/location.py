"""The location of a store: a directory, or a prefix of a bucket.

`StoreDirectory` and `StoreInBucket` have the same methods, so other code does not distinguish them. Both guarantee that
a store appears whole or not at all, that a file is replaced in one step or not at all, and that only one run writes to
a store.
"""

import fcntl
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import lru_cache
from pathlib import Path
from uuid import uuid4

from gear_rattle.workers.errors import SurveyError, storage_error
from gear_rattle.workers.storage.bucket import LOCK, SCHEME, StoreInBucket
from gear_rattle.workers.survey.manifest import ROOT

CERTIFICATES = ".certificates.zarr"  # ending of the path of a store of certificates


class StoreDirectory:
    """A store on a file system."""

    def __init__(self, path: str | Path) -> None:
        try:
            self.path = Path(os.path.expanduser(path)).resolve()  # shells do not expand `--out=~/x`
        except OSError as error:  # the working directory is gone
            where = "change to an existing directory, or give an absolute path"
            raise SurveyError(f"{path} cannot be located ({error}): {where}") from error

    def __str__(self) -> str:
        """Return the path."""
        return str(self.path)

    def zarr(self) -> Path:
        """Return the path that zarr opens."""
        return self.path

    def is_occupied(self) -> bool:
        """Return whether the path exists and is not an empty directory."""
        return self.path.exists() and not (self.path.is_dir() and next(self.path.iterdir(), None) is None)

    def exists(self) -> bool:
        """Return whether the path has a whole store."""
        return (self.path / ROOT).exists()

    def has_deletion_begun(self) -> bool:
        """Return False, because a directory whose deletion has begun has another name."""
        return False

    def read(self, key: str) -> bytes:
        """Return the content of a file. Raises OSError."""
        return (self.path / key).read_bytes()

    def translate_errors(self) -> AbstractContextManager[None]:
        """Return a context that does nothing, because OSError needs no translation, unlike the errors of a bucket."""
        return nullcontext()

    def build(self, template: Mapping[str, bytes]) -> None:
        """Create the store under a temporary name, and rename it. A store that another run has created here is kept."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        sibling = self.path.with_name(f".{self.path.name}.{uuid4().hex}")
        try:
            for directory in {(sibling / key).parent for key in template}:
                directory.mkdir(parents=True, exist_ok=True)
            for key, content in template.items():
                (sibling / key).write_bytes(content)
            (sibling / LOCK).touch()
            os.rename(sibling, self.path)
        except OSError:
            if not self.is_occupied():  # otherwise another run has created a store here, which the caller then checks
                raise
        finally:
            shutil.rmtree(sibling, ignore_errors=True)

    def put(self, key: str, content: bytes) -> None:
        """Write or replace a file in one step. Raises OSError."""
        target = self.path / key
        partial = target.with_name(f"{target.name}.{uuid4().hex}.partial")
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            partial.write_bytes(content)
            os.replace(partial, target)
        except OSError:
            partial.unlink(missing_ok=True)
            raise

    def remove(self, keys: Iterable[str]) -> None:
        """Remove files, and ignore missing files. Raises OSError."""
        for key in keys:
            (self.path / key).unlink(missing_ok=True)

    @contextmanager
    def lock_for_writing(self) -> Iterator[None]:
        """Lock the store for one run; the system releases the lock even if the process is killed.

        On a file system without locks, this method does not keep a second run out.

        Raises
        ------
        StorageError
            The store cannot be written now.
        SurveyError
            Another run has locked the store (two runs would remove each other's files), or there is no store.
        """
        try:
            held = (self.path / LOCK).open("ab")
        except OSError as error:
            refusal = storage_error(f"{self} cannot be written", error)
            raise refusal from error
        with held:
            try:
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise SurveyError(
                    f"{self} is being computed by another run: wait until that run ends, or choose another path"
                ) from None
            except OSError:
                pass  # a file system without locks cannot keep a second run out of the store
            yield

    def remove_leftovers(self) -> None:
        """Remove the partial files of killed writers."""
        for stray in self.path.rglob("*.partial"):
            stray.unlink(missing_ok=True)


Place = StoreDirectory | StoreInBucket


def place_of(where: str | Path | Place) -> Place:
    """Return the location for a path or the URL of a bucket. Raises SurveyError for other URLs."""
    if isinstance(where, StoreDirectory | StoreInBucket):
        return where
    if "://" not in str(where):
        return StoreDirectory(where)
    if not str(where).startswith(SCHEME):
        raise SurveyError(f"{where} is not a location of a store: give a path, or {SCHEME}BUCKET/PREFIX")
    return _store_in_bucket(str(where))


def certificates_path(where: str | Path | Place) -> Path:
    """Return the path of the store for a survey's certificates, beside the survey. Raises SurveyError for a bucket."""
    place = place_of(where)
    if isinstance(place, StoreInBucket):
        raise SurveyError(
            f"certificates are written to a directory beside the survey's, and {place} is in a bucket: leave out "
            "certify, and prove the survey afterwards with rattle certify STORE --out PATH"
        )
    return place.path.with_name(place.path.name.removesuffix(".zarr") + CERTIFICATES)


@lru_cache(maxsize=64)
def _store_in_bucket(url: str) -> StoreInBucket:
    return StoreInBucket(url)
