"""Locate a store: a directory, or a prefix of a bucket.

The differences of the two are here and nowhere else.

Both promise: a store appears whole or not at all, a key is replaced at once or not at all, and one run writes to it.
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
from gear_rattle.workers.storage.bucket import LOCK, SCHEME, Bucket
from gear_rattle.workers.survey.manifest import ROOT

CERTIFICATES = ".certificates.zarr"  # the ending of a store of certificates


class Directory:
    """A store on a file system."""

    def __init__(self, path: str | Path) -> None:
        try:
            self.path = Path(os.path.expanduser(path)).resolve()  # no shell expands `--out=~/x`
        except OSError as error:  # the working directory is gone
            where = "go to a directory that is there, or give a whole path"
            raise SurveyError(f"{path} is nowhere ({error}): {where}") from error

    def __str__(self) -> str:
        """Return a readable description."""
        return str(self.path)

    def zarr(self) -> Path:
        """Return what zarr opens."""
        return self.path

    def occupied(self) -> bool:
        """Return whether anything is here."""
        return self.path.exists() and not (self.path.is_dir() and next(self.path.iterdir(), None) is None)

    def exists(self) -> bool:
        """Return whether a whole store is here."""
        return (self.path / ROOT).exists()

    def deletion_begun(self) -> bool:
        """Return whether a deletion was begun and has not ended: never, it begins by renaming."""
        return False

    def read(self, key: str) -> bytes:
        """Return a file. Raises OSError."""
        return (self.path / key).read_bytes()

    def reaching(self) -> AbstractContextManager[None]:
        """Let errors of the file system pass as they are: OSError."""
        return nullcontext()

    def build(self, template: Mapping[str, bytes]) -> None:
        """Create the store: beside its place, and renamed."""
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
            if not self.occupied():  # otherwise another run was first, and its store is judged like any other
                raise
        finally:
            shutil.rmtree(sibling, ignore_errors=True)

    def put(self, key: str, content: bytes) -> None:
        """Write a file, or replace it at once. Raises OSError."""
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
        """Remove files; those that are not there are left out. Raises OSError."""
        for key in keys:
            (self.path / key).unlink(missing_ok=True)

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Hold the store for one run; the system releases it even if the process is killed.

        Raises
        ------
        StorageError
            It cannot be written now.
        SurveyError
            Another run holds it: two would sweep each other's files. Or it is not there.
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
                    f"{self} is being computed by another run: wait for it, or choose another path"
                ) from None
            except OSError:
                pass  # a file system without locks
            yield

    def sweep(self) -> None:
        """Remove what killed writers left."""
        for stray in self.path.rglob("*.partial"):
            stray.unlink(missing_ok=True)


Place = Directory | Bucket


def place_of(where: str | Path | Place) -> Place:
    """Return the place that a path or a URL names. Raises SurveyError for a URL that is none of a bucket."""
    if isinstance(where, Directory | Bucket):
        return where
    if "://" not in str(where):
        return Directory(where)
    if not str(where).startswith(SCHEME):
        raise SurveyError(f"{where}: a store is a path, or {SCHEME}BUCKET/PREFIX")
    return _bucket(str(where))


def certificates_of(where: str | Path | Place) -> Path:
    """Return where the certificates of a survey are: beside its store. Raises SurveyError for a bucket."""
    place = place_of(where)
    if isinstance(place, Bucket):
        raise SurveyError(
            f"certificates are written to a directory beside the survey's, and {place} is in a bucket: leave certify "
            "out, and prove it afterwards: rattle certify STORE --out PATH"
        )
    return place.path.with_name(place.path.name.removesuffix(".zarr") + CERTIFICATES)


@lru_cache(maxsize=64)
def _bucket(url: str) -> Bucket:
    return Bucket(url)
