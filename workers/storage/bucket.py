"""A store on S3-compatible object storage, reached through obstore.

A bucket has neither rename nor locks. A store is whole once its root `zarr.json` is there, which is written last, and
only if no other process has written one; deletion is in the opposite order. Settings are those of obstore: the
variables AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION, AWS_ENDPOINT, and AWS_ALLOW_HTTP for tests.
"""

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import timedelta
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from zarr.storage import ObjectStore

from gear_rattle.workers.errors import StorageError, SurveyError
from gear_rattle.workers.storage.bucket_lock import has_died, identity
from gear_rattle.workers.survey.manifest import ROOT

if TYPE_CHECKING:
    from obstore.store import S3Store

SCHEME = "s3://"
#: Markers of a prefix that is not only a store: its creation or deletion has begun, or a run has locked it.
CREATING, DELETING, LOCK = ".creating", ".deleting", ".lock"
MARKERS = (CREATING, DELETING, LOCK)
#: A failed request is repeated for so many seconds before the survey has to wait. The number of retries is never
#: reached in that time, even when a restarting server refuses connections at once.
RETRIES, RETRY_SECONDS = 1000, 60


class Bucket:
    """A prefix of a bucket.

    Parameters
    ----------
    url
        `s3://BUCKET/PREFIX`.
    owned
        True if the caller is known to be the only writer, as a service with a locked job database is; no lock is taken
        then.

    Raises
    ------
    SurveyError
        The URL names no prefix of a bucket, or obstore is not installed.
    """

    def __init__(self, url: str, owned: bool = False) -> None:
        parts = urlsplit(url)
        if not parts.netloc or not parts.path.strip("/") or parts.query or parts.fragment or parts.username:
            raise SurveyError(f"{url}: write {SCHEME}BUCKET/PREFIX, without more")
        self.url = f"{SCHEME}{parts.netloc}/{parts.path.strip('/')}"
        self._owned = owned
        self.objects = _connect(self.url)

    def __str__(self) -> str:
        """Return the URL."""
        return self.url

    def zarr(self) -> ObjectStore:
        """Return the store that zarr opens."""
        return ObjectStore(self.objects)

    def occupied(self) -> bool:
        """Return whether anything is here except the remains of a killed creation."""
        with self.reaching():
            if self.has(ROOT) or self.has(DELETING):
                return True
            return not self.has(CREATING) and any(key not in MARKERS for key in self.keys())

    def exists(self) -> bool:
        """Return whether a whole store is here."""
        with self.reaching():
            return self.has(ROOT)

    def has(self, key: str) -> bool:
        """Return whether a key is here."""
        import obstore

        try:
            obstore.head(self.objects, key)
        except FileNotFoundError:
            return False
        return True

    def read(self, key: str) -> bytes:
        """Return an object. Raises FileNotFoundError, or what `reaching` does."""
        return self.read_tagged(key)[0]

    def read_tagged(self, key: str) -> tuple[bytes, str]:
        """Return an object and its ETag. Raises as `read` does."""
        import obstore

        with self.reaching():
            found = obstore.get(self.objects, key)
            return bytes(found.bytes()), found.meta["e_tag"] or '""'

    def keys(self, prefix: str = "") -> Iterator[str]:
        """Yield every key below a prefix."""
        import obstore

        for batch in obstore.list(self.objects, prefix or None):
            yield from (each["path"] for each in batch)

    def children(self) -> list[str]:
        """Return the names one level below the prefix."""
        import obstore

        with self.reaching():
            found = obstore.list_with_delimiter(self.objects)
        return [prefix.rstrip("/").rpartition("/")[2] for prefix in found["common_prefixes"]]

    def deletion_begun(self) -> bool:
        """Return whether a deletion has begun and not ended."""
        with self.reaching():
            return self.has(DELETING)

    @contextmanager
    def reaching(self) -> Iterator[None]:
        """Turn errors of obstore into errors of this project.

        Raises
        ------
        StorageError
            The object store does not answer, or fails.
        SurveyError
            The object store refuses: the credentials, or the bucket, are wrong.
        """
        from obstore import exceptions

        try:
            yield
        except (exceptions.PermissionDeniedError, exceptions.UnauthenticatedError) as error:
            raise SurveyError(f"{self} may not be used ({_first_line(error)}): check the credentials") from error
        except exceptions.BaseError as error:
            if "NoSuchBucket" in str(error):
                raise SurveyError(f"{self}: there is no such bucket: create it, or correct the URL") from error
            raise StorageError(
                f"{self} cannot be reached ({_first_line(error)}): the survey continues when it can"
            ) from error

    def build(self, template: Mapping[str, bytes]) -> None:
        """Create the store; its root is written last, unless another run has written one meanwhile."""
        import obstore
        from obstore.exceptions import AlreadyExistsError

        with self.writing(), self.reaching():
            obstore.put(self.objects, CREATING, b"")
            for key in sorted(template.keys() - {ROOT}):
                obstore.put(self.objects, key, template[key])
            with suppress(AlreadyExistsError):
                obstore.put(self.objects, ROOT, template[ROOT], mode="create")
            obstore.delete(self.objects, CREATING)

    def put(self, key: str, content: bytes) -> None:
        """Write or replace an object in one step. Raises what `reaching` does."""
        import obstore

        with self.reaching():
            obstore.put(self.objects, key, content)

    def remove(self, keys: Iterable[str]) -> None:
        """Remove objects; missing ones are ignored. Raises what `reaching` does."""
        import obstore

        with self.reaching():
            obstore.delete(self.objects, list(keys))

    def sweep(self) -> None:
        """Remove the marker of a killed creation."""
        import obstore

        with self.reaching():
            obstore.delete(self.objects, CREATING)

    def delete(self) -> None:
        """Delete the store. Its root is removed first, so that a half-deleted store is never taken for a store."""
        import obstore

        with self.reaching():
            if next(self.keys(), None) is None:
                return
            obstore.put(self.objects, DELETING, b"")
            obstore.delete(self.objects, ROOT)
            for batch in obstore.list(self.objects):
                obstore.delete(self.objects, [each["path"] for each in batch if each["path"] != DELETING])
            obstore.delete(self.objects, DELETING)

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Lock the store for one run, by an object that names the run.

        Raises
        ------
        StorageError
            The object store fails.
        SurveyError
            Another run has locked the store, or was killed on another machine and left its lock.
        """
        if self._owned:
            yield
            return
        import obstore

        mine = json.dumps(identity()).encode()
        with self.reaching():
            self._take_lock(mine)
        try:
            yield
        finally:
            with suppress(OSError, SurveyError):
                if self.read(LOCK) == mine:
                    obstore.delete(self.objects, LOCK)

    def _take_lock(self, mine: bytes) -> None:
        import obstore
        from obstore.exceptions import AlreadyExistsError, PreconditionError

        try:
            obstore.put(self.objects, LOCK, mine, mode="create")
            return
        except AlreadyExistsError:
            pass
        try:
            found = obstore.get(self.objects, LOCK)
            holder = json.loads(bytes(found.bytes()))
            if has_died(holder):
                obstore.put(self.objects, LOCK, mine, mode={"e_tag": found.meta["e_tag"]})
                return
        except (FileNotFoundError, PreconditionError):
            holder = {}  # the lock was released or taken over at this moment
        except (ValueError, TypeError, KeyError):
            holder = {"process": "unknown"}
        who = (
            f" (process {holder.get('process')} on {holder.get('host')} since {holder.get('since')})" if holder else ""
        )
        raise SurveyError(
            f"{self} is being computed by another run{who}: wait for it, or choose another location. If that run was"
            f" killed, delete the object {self}/{LOCK}"
        )


def _connect(url: str) -> "S3Store":
    try:
        from obstore.exceptions import BaseError
        from obstore.store import S3Store
    except ImportError as error:
        raise SurveyError(f"{url} needs obstore: pip install 'gear-rattle[s3]'") from error
    try:
        return S3Store.from_url(
            url,
            # given options hide this variable from obstore
            client_options={
                "timeout": timedelta(seconds=RETRY_SECONDS),
                "allow_http": os.environ.get("AWS_ALLOW_HTTP", "").lower() in ("true", "1"),
            },
            retry_config={"max_retries": RETRIES, "retry_timeout": timedelta(seconds=RETRY_SECONDS)},
        )
    except (BaseError, ValueError) as error:
        raise SurveyError(f"{url} cannot be used ({_first_line(error)}): check the variables AWS_…") from error


def _first_line(error: BaseException) -> str:
    return str(error).strip().partition("\n")[0][:300]
