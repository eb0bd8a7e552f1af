"""A store on S3-compatible object storage, reached through obstore.

A bucket has neither rename nor locks. Creation writes the root `zarr.json` last, and only if no other process has
written it; so a store with a root is whole. Deletion removes the root first. obstore reads its settings from the
environment variables AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION, AWS_ENDPOINT, and AWS_ALLOW_HTTP (for
tests).
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
from gear_rattle.workers.storage.bucket_lock import has_lock_holder_died, process_identity
from gear_rattle.workers.survey.manifest import ROOT

if TYPE_CHECKING:
    from obstore.store import S3Store

SCHEME = "s3://"
#: Keys of objects beside the files of a store. CREATING exists while the store is created, DELETING while the store is
#: deleted, and LOCK while a run writes to the store.
CREATING, DELETING, LOCK = ".creating", ".deleting", ".lock"
MARKERS = (CREATING, DELETING, LOCK)
#: A failed request is repeated for RETRY_SECONDS; then it raises StorageError. RETRIES is so large that only the time
#: ends the attempts, even while a restarting server refuses each connection at once.
RETRIES, RETRY_SECONDS = 1000, 60


class StoreInBucket:
    """The location of a store in a bucket: all objects whose keys begin with a prefix.

    Parameters
    ----------
    url
        `s3://BUCKET/PREFIX`.
    owned
        True if the caller is the only writer, such as a service that has locked its job database. Then the store is not
        locked.

    Raises
    ------
    SurveyError
        The URL has no bucket or no prefix, or obstore is not installed.
    """

    def __init__(self, url: str, owned: bool = False) -> None:
        parts = urlsplit(url)
        if not parts.netloc or not parts.path.strip("/") or parts.query or parts.fragment or parts.username:
            raise SurveyError(
                f"{url} is not the URL of a store: write {SCHEME}BUCKET/PREFIX, without a query, a fragment or a user "
                "name"
            )
        self.url = f"{SCHEME}{parts.netloc}/{parts.path.strip('/')}"
        self._owned = owned
        self.objects = _connect(self.url)

    def __str__(self) -> str:
        """Return the URL."""
        return self.url

    def zarr(self) -> ObjectStore:
        """Return the store that zarr opens."""
        return ObjectStore(self.objects)

    def is_occupied(self) -> bool:
        """Return whether the prefix has a store or other objects. Objects that a killed creation left do not count."""
        with self.translate_errors():
            if self.has(ROOT) or self.has(DELETING):
                return True
            return not self.has(CREATING) and any(key not in MARKERS for key in self.keys())

    def exists(self) -> bool:
        """Return whether the prefix has a whole store, that is, a root: the root is written last."""
        with self.translate_errors():
            return self.has(ROOT)

    def has(self, key: str) -> bool:
        """Return whether the prefix has an object with this key."""
        import obstore

        try:
            obstore.head(self.objects, key)
        except FileNotFoundError:
            return False
        return True

    def read(self, key: str) -> bytes:
        """Return the content of an object. Raises FileNotFoundError, and the errors of `translate_errors`."""
        return self.read_with_etag(key)[0]

    def read_with_etag(self, key: str) -> tuple[bytes, str]:
        """Return the content and the ETag of an object. Raises the same errors as `read`."""
        import obstore

        with self.translate_errors():
            found = obstore.get(self.objects, key)
            return bytes(found.bytes()), found.meta["e_tag"] or '""'

    def keys(self, prefix: str = "") -> Iterator[str]:
        """Yield every key below a prefix of whole path segments, such as "a/b"; by default all keys."""
        import obstore

        for batch in obstore.list(self.objects, prefix or None):
            yield from (each["path"] for each in batch)

    def children(self) -> list[str]:
        """Return the names of the directories one level below the prefix."""
        import obstore

        with self.translate_errors():
            found = obstore.list_with_delimiter(self.objects)
        return [prefix.rstrip("/").rpartition("/")[2] for prefix in found["common_prefixes"]]

    def has_deletion_begun(self) -> bool:
        """Return whether a deletion has begun and not ended."""
        with self.translate_errors():
            return self.has(DELETING)

    @contextmanager
    def translate_errors(self) -> Iterator[None]:
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
            raise SurveyError(
                f"access to {self} is denied ({_first_line(error)}): check the environment variables AWS_…"
            ) from error
        except exceptions.BaseError as error:
            if "NoSuchBucket" in str(error):
                raise SurveyError(f"{self}: there is no such bucket: create it, or correct the URL") from error
            raise StorageError(
                f"{self} cannot be used now ({_first_line(error)}): try again when the object store answers"
            ) from error

    def build(self, template: Mapping[str, bytes]) -> None:
        """Create the store. The root is written last. A root that another run has written meanwhile is kept."""
        import obstore
        from obstore.exceptions import AlreadyExistsError

        with self.lock_for_writing(), self.translate_errors():
            obstore.put(self.objects, CREATING, b"")
            for key in sorted(template.keys() - {ROOT}):
                obstore.put(self.objects, key, template[key])
            with suppress(AlreadyExistsError):
                obstore.put(self.objects, ROOT, template[ROOT], mode="create")
            obstore.delete(self.objects, CREATING)

    def put(self, key: str, content: bytes) -> None:
        """Write or replace an object in one step. Raises the errors of `translate_errors`."""
        import obstore

        with self.translate_errors():
            obstore.put(self.objects, key, content)

    def remove(self, keys: Iterable[str]) -> None:
        """Remove objects; missing ones are ignored. Raises the errors of `translate_errors`."""
        import obstore

        with self.translate_errors():
            obstore.delete(self.objects, list(keys))

    def remove_leftovers(self) -> None:
        """Remove the marker that is left if the creation of the store was killed."""
        import obstore

        with self.translate_errors():
            obstore.delete(self.objects, CREATING)

    def delete(self) -> None:
        """Delete the store. The root is removed first, so that a half-deleted store does not look like a store."""
        import obstore

        with self.translate_errors():
            if next(self.keys(), None) is None:
                return
            obstore.put(self.objects, DELETING, b"")
            obstore.delete(self.objects, ROOT)
            for batch in obstore.list(self.objects):
                obstore.delete(self.objects, [each["path"] for each in batch if each["path"] != DELETING])
            obstore.delete(self.objects, DELETING)

    @contextmanager
    def lock_for_writing(self) -> Iterator[None]:
        """Lock the store for one run, by an object that names the run.

        A store that was opened with `owned` is not locked, because no other process writes to it.

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

        identity = json.dumps(process_identity()).encode()
        with self.translate_errors():
            self._take_lock(identity)
        try:
            yield
        finally:
            with suppress(OSError, SurveyError):
                if self.read(LOCK) == identity:
                    obstore.delete(self.objects, LOCK)

    def _take_lock(self, identity: bytes) -> None:
        """Write the lock, with the identity of this process as content. Raises SurveyError if another run has it."""
        import obstore
        from obstore.exceptions import AlreadyExistsError, PreconditionError

        try:
            obstore.put(self.objects, LOCK, identity, mode="create")
            return
        except AlreadyExistsError:
            pass
        try:
            found = obstore.get(self.objects, LOCK)
            holder = json.loads(bytes(found.bytes()))
            if has_lock_holder_died(holder):
                obstore.put(self.objects, LOCK, identity, mode={"e_tag": found.meta["e_tag"]})
                return
        except (FileNotFoundError, PreconditionError):
            holder = {}  # another run released the lock, or took it over, since the failed attempt above
        except (ValueError, TypeError, KeyError):
            holder = {"process": "unknown"}
        who = (
            f" (process {holder.get('process')} on {holder.get('host')} since {holder.get('since')})" if holder else ""
        )
        raise SurveyError(
            f"{self} is being computed by another run{who}: wait until that run ends, or choose another location. If "
            f"that run was killed, delete the object {self}/{LOCK}"
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
            # `allow_http` is set here, because with client options obstore does not read AWS_ALLOW_HTTP itself.
            client_options={
                "timeout": timedelta(seconds=RETRY_SECONDS),
                "allow_http": os.environ.get("AWS_ALLOW_HTTP", "").lower() in ("true", "1"),
            },
            retry_config={"max_retries": RETRIES, "retry_timeout": timedelta(seconds=RETRY_SECONDS)},
        )
    except (BaseError, ValueError) as error:
        raise SurveyError(
            f"{url} cannot be used ({_first_line(error)}): check this URL, and the environment variables AWS_…"
        ) from error


def _first_line(error: BaseException) -> str:
    return str(error).strip().partition("\n")[0][:300]
