"""The data directory: the job database, a store for each survey, and a lock against a second service."""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from filelock import FileLock, Timeout
from sqlalchemy import URL

from gear_rattle.service.errors import DataDirectoryError, DirectoryMissingError
from gear_rattle.workers.storage.location import CERTIFICATES, certificates_path

if TYPE_CHECKING:
    from gear_rattle.workers import StoreInBucket

TRASH_PREFIX = ".trash-"
IDENTITY_FILE = "identity"
SURVEY_ID = r"(?P<survey>[0-9a-f]{16})"
#: Patterns of the names of a store during its deletion, a store during its creation, a finished store, and the
#: certificates of a store.
DELETION, TEMPORARY, SURVEY_STORE, CERTIFICATE_STORE = (
    re.compile(pattern)
    for pattern in (
        rf"\.trash-{SURVEY_ID}",
        rf"\.{SURVEY_ID}\.zarr\.[0-9a-f]{{32}}",
        rf"{SURVEY_ID}\.zarr",
        SURVEY_ID + re.escape(CERTIFICATES),
    )
)


@dataclass(frozen=True)
class StoreEntry:
    """An entry in the directory of stores.

    An entry is a file or a directory, such as the store of a survey or the store of its certificates.

    survey_id: id of the survey to which the entry belongs; empty if it belongs to none. is_deletion: True for a store
    whose deletion has begun. is_temporary: True for a store whose creation has not ended. remove: function that
    removes the entry.
    """

    name: str
    survey_id: str
    is_deletion: bool
    is_temporary: bool
    remove: Callable[[], None]

    @classmethod
    def from_path(cls, path: Path) -> StoreEntry:
        """Return the description of the file or directory at a path."""

        def remove() -> None:
            shutil.rmtree(path, ignore_errors=True)

        for pattern in (DELETION, TEMPORARY, SURVEY_STORE, CERTIFICATE_STORE):
            if match := pattern.fullmatch(path.name):
                return cls(str(path), match["survey"], pattern is DELETION, pattern is TEMPORARY, remove)
        return cls(str(path), "", is_deletion=False, is_temporary=False, remove=remove)


class DataDirectory:
    """The data directory of one service: its lock and, unless the settings name others, its job database and stores.

    Parameters
    ----------
    path
        Path of the directory; :meth:`lock` creates it if it does not exist.
    """

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()
        self.identity = ""
        self._stores, self._database = self.path / "surveys", self.path / "jobs.sqlite"

    @property
    def database_url(self) -> URL:
        """URL of the SQLite job database in this directory, whether it exists or not."""
        return URL.create("sqlite", database=str(self._database))

    @property
    def has_database(self) -> bool:
        """True if this directory contains a job database."""
        return self._database.exists()

    def store(self, survey_id: str) -> Path | StoreInBucket:
        """Return the location of a survey's zarr store, whether it exists or not.

        Returns
        -------
        Path | StoreInBucket
            A path, or the prefix of a bucket.

        Raises
        ------
        DirectoryMissingError
            The data directory is missing.
        """
        self.require_present()
        return self._path_of(survey_id)

    def _path_of(self, survey_id: str) -> Path:
        return self._stores / f"{survey_id}.zarr"

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Lock the directory during this context. The lock also ends with the process, even by SIGKILL.

        Raises
        ------
        DataDirectoryError
            The directory cannot be used, or another service has locked it.
        """
        try:
            self._stores.mkdir(parents=True, exist_ok=True)
            lock = FileLock(self.path / "lock", timeout=0, thread_local=False)
            lock.acquire()
        except Timeout as error:
            raise DataDirectoryError(
                f"Another service uses the data directory {self.path}. Stop that service, or give this service another "
                "directory. A service is one process: start uvicorn without --workers."
            ) from error
        except OSError as error:
            raise DataDirectoryError(f"The data directory {self.path} cannot be used: {error}") from error
        with lock:
            yield

    def check_identity(self, recorded: str | None = None) -> None:
        """Check the identity (the text of IDENTITY_FILE) of the locked directory; give an identity to a new directory.

        Parameters
        ----------
        recorded : str | None
            Identity that a job database outside the directory has recorded. None accepts any directory.

        Raises
        ------
        DataDirectoryError
            The directory has another identity than the recorded one, or is new although an identity is recorded, or
            cannot be written to.
        """
        try:
            self.identity = self._read_identity()
            if recorded and self.identity != recorded and (self.identity or not any(self._stores.iterdir())):
                raise DataDirectoryError(
                    f"{self.path} is not the data directory that the job database has recorded: check that the right "
                    "disk is mounted. To use this directory anyway, without the stores of the recorded directory, run: "
                    f"echo {recorded} > {self.path / IDENTITY_FILE}"
                )
            if not self.identity:  # a new directory, or a directory of an older version, which wrote no identity
                self.identity = recorded or secrets.token_hex(16)
                new = self.path / f".{IDENTITY_FILE}"
                new.write_text(f"{self.identity}\n")
                os.replace(new, self.path / IDENTITY_FILE)
        except OSError as error:
            raise DataDirectoryError(f"The data directory {self.path} cannot be used: {error}") from error

    def require_present(self) -> None:
        """Check that the directory is still the one that `check_identity` has checked.

        Raises
        ------
        DirectoryMissingError
            The directory cannot be read, or has another identity, for example because its disk is no longer mounted.
        """
        try:
            there = self._read_identity() == self.identity
        except OSError:  # the disk fails
            there = False
        if self.identity and not there:
            raise DirectoryMissingError

    def _read_identity(self) -> str:
        try:
            return (self.path / IDENTITY_FILE).read_text(errors="replace").strip()
        except (FileNotFoundError, NotADirectoryError):
            return ""

    def remove_store(self, survey_id: str) -> None:
        """Delete the certificates and then the store of a survey.

        The store is renamed first, so that a crash never leaves half of a store under the store's name.
        """
        shutil.rmtree(certificates_path(self._path_of(survey_id)), ignore_errors=True)
        trash = self._stores / f"{TRASH_PREFIX}{survey_id}"
        try:
            os.rename(self._path_of(survey_id), trash)
        except FileNotFoundError:
            return
        shutil.rmtree(trash, ignore_errors=True)

    def entries(self) -> list[StoreEntry]:
        """Return all entries of the directory of stores."""
        return [StoreEntry.from_path(path) for path in sorted(self._stores.iterdir())]

    def remove_partial_files(self, survey_id: str, content_hash: str) -> None:
        """Remove the partial files of killed writers from a survey's store, if the store has this content hash.

        No process may write to the store meanwhile.
        """
        store = self._path_of(survey_id)
        try:
            found = json.loads((store / "zarr.json").read_bytes())["attributes"]["content_hash"]
        except (OSError, ValueError, KeyError, TypeError):
            return  # the path is no store of a survey; the job manager reports this when it continues the survey
        if found == content_hash:
            for stray in store.rglob("*.partial"):
                stray.unlink(missing_ok=True)
