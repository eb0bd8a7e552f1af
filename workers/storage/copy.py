"""Copy a store, comparing each file with its digest both at the source and at the target."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol
from zipfile import ZIP_STORED, BadZipFile, ZipFile

from gear_rattle.workers.errors import SurveyError, storage_error
from gear_rattle.workers.storage.bucket import CREATING, LOCK, StoreInBucket
from gear_rattle.workers.storage.location import Place, StoreDirectory, place_of
from gear_rattle.workers.survey.manifest import MANIFEST, ROOT, Manifest, digest
from rattle import MissingExtraError

if TYPE_CHECKING:
    import icechunk
    from zarr.abc.store import Store

ZIP, ICECHUNK = ".zip", ".icechunk"
BRANCH = "main"  # the branch of an Icechunk repository that gets the commit
READERS = 8  # files read at a time, because a bucket answers slowly
BATCH = 256  # at most this many files are in memory at a time


class CopyResult(NamedTuple):
    """Result of a copy: the number of files, the bytes of all files, and how many files the target already had."""

    files: int
    size: int
    kept: int


class FileSource(Protocol):
    """The source of a copy: a directory, a bucket or a zip file, whose files are read by key."""

    def read(self, key: str) -> bytes:
        """Return the content of a file. Raises OSError."""


class ZipStore:
    """A store in a zip file, in the form that zarr reads. Its files are not compressed, because chunks already are."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file = ZipFile(path)
        except (OSError, BadZipFile) as error:
            raise SurveyError(f"{path} cannot be opened ({error}): give a zip file that `rattle copy` wrote") from error

    def __str__(self) -> str:
        """Return the path."""
        return str(self.path)

    def read(self, key: str) -> bytes:
        """Return the content of a file in the zip file. Raises FileNotFoundError."""
        try:
            return self._file.read(key)
        except (KeyError, BadZipFile) as error:
            raise FileNotFoundError(f"{key} is missing or damaged in {self.path}") from error


def copy_store(
    source: str | Path | Place, target: str | Path, on_file: Callable[[int, int], None] | None = None
) -> CopyResult:
    """Copy a survey or population, finished or not, to a directory, a bucket, a zip file or an Icechunk repository.

    The same call continues an interrupted copy, and keeps undamaged files of the target. The root is written
    last; until then the copy is not a store. A zip file appears only when it is complete. A repository has the whole
    copy as one commit on its branch main, without the manifest, so that it can be read but not copied back.

    Parameters
    ----------
    source
        Path, s3:// URL or zip file of a survey's or population's store.
    target
        Path, s3:// URL, zip file, or directory of a repository that ends in .icechunk. A zip file must not exist. Any
        other target must not exist, or must have an interrupted copy of this store.
    on_file
        Called with the number of copied files and the number of all files.

    Returns
    -------
    CopyResult
        Files and bytes of the copy.

    Raises
    ------
    SurveyError
        The source is not a store, one of its files is damaged, or the target has other contents.
    StorageError
        The target cannot be written, or does not read back as it was written.
    MissingExtraError
        The target is an Icechunk repository, and icechunk is not installed.
    """
    files = _open_source(source)
    manifest, content = _read_manifest(files)
    if str(target).endswith(ZIP):
        with _translate_write_errors(Path(target)):
            return _copy_to_zip(files, manifest, content, Path(target), on_file)
    if str(target).endswith(ICECHUNK):
        with _translate_write_errors(Path(target)):
            return _copy_to_icechunk(files, manifest, Path(target), on_file)
    place = place_of(target)
    before = _read_earlier_manifest(place)
    if before is not None and before.content_hash != manifest.content_hash:
        raise SurveyError(f"{place} holds another survey or population: choose another location, or remove that store")
    if before is None and place.is_occupied():
        raise SurveyError(f"{place} holds something that is not a copy of {source}: choose another location")
    with _translate_write_errors(place):
        if isinstance(place, StoreDirectory):
            place.path.mkdir(parents=True, exist_ok=True)
            (place.path / LOCK).touch()
        with place.lock_for_writing():
            return _copy_to_place(files, manifest, content, place, on_file)


@contextmanager
def _translate_write_errors(target: Path | Place) -> Iterator[None]:
    """Convert an OSError into the SurveyError or StorageError that says that the target cannot be written."""
    try:
        yield
    except OSError as error:
        refusal = storage_error(f"{target} cannot be written", error)
        raise refusal from error


def _open_source(source: str | Path | Place) -> FileSource:
    return ZipStore(Path(str(source))) if str(source).endswith(ZIP) else place_of(source)


def _read_manifest(files: FileSource) -> tuple[Manifest, bytes]:
    try:
        content = files.read(MANIFEST)
    except (FileNotFoundError, NotADirectoryError):
        content = b""
    manifest = Manifest.from_bytes(content)
    if manifest is None:
        raise SurveyError(
            f"{files} has no {MANIFEST} that this version can read: give the path of a store; rattle verify finds "
            "damage of a store"
        )
    return manifest, content


def _read_earlier_manifest(place: Place) -> Manifest | None:
    """Return the manifest that an earlier copy left at the target; None if the target has no readable manifest."""
    with suppress(FileNotFoundError, NotADirectoryError):
        return Manifest.from_bytes(place.read(MANIFEST))
    return None


def _keys_with_digests(manifest: Manifest) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the key and the allowed digests of every file except the manifest; the root comes last."""
    for key, known in manifest.files.items():
        yield key, (known,)
    for tile in manifest.tiles:
        for key, known in manifest.digests_of_tile(tile).items():
            yield key, (known,)
    yield ROOT, manifest.root


def _has_known_digest(files: FileSource, key: str, known: Sequence[str]) -> bool:
    """Return whether a file exists and has one of the digests `known`."""
    try:
        return digest(files.read(key)) in known
    except (FileNotFoundError, NotADirectoryError):
        return False


def _read_with_known_digest(files: FileSource, key: str, known: Sequence[str]) -> bytes:
    """Return the content of a file. Raises SurveyError if it is lost, or has none of the digests `known`."""
    try:
        content = files.read(key)
    except (FileNotFoundError, NotADirectoryError):
        content = None
    if content is None or digest(content) not in known:
        raise SurveyError(
            f"{key} of {files} is {'lost' if content is None else 'damaged'}, so the store cannot be copied: "
            "rattle verify lists all such files, and the command that computed the store computes them again"
        )
    return content


def _copy_to_place(
    files: FileSource, manifest: Manifest, content: bytes, place: Place, on_file: Callable[[int, int], None] | None
) -> CopyResult:
    if isinstance(place, StoreInBucket):
        place.put(CREATING, b"")
    place.put(MANIFEST, content)

    def copy_file(file: tuple[str, tuple[str, ...]]) -> tuple[int, bool]:
        """Copy a file, given by its key and its allowed digests. Return its size, and whether the target had it."""
        key, known = file
        part = _read_with_known_digest(files, key, known)
        if kept := _has_known_digest(place, key, known):
            return len(part), kept
        place.put(key, part)
        if not _has_known_digest(place, key, known):
            raise OSError(f"{key} does not read back as it was written")
        return len(part), False

    total, size, kept, done = _count_files(manifest), len(content), 0, 1
    keys = list(_keys_with_digests(manifest))
    with ThreadPoolExecutor(READERS) as threads:
        for some in _batches_of_files(keys[:-1]):
            for length, was_there in threads.map(copy_file, some):
                size, kept, done = size + length, kept + was_there, done + 1
            if on_file:
                on_file(done, total)
    length, was_there = copy_file(keys[-1])
    if isinstance(place, StoreInBucket):
        place.remove_leftovers()
    if on_file:
        on_file(total, total)
    return CopyResult(total, size + length, kept + was_there)


def _copy_to_zip(
    files: FileSource, manifest: Manifest, content: bytes, path: Path, on_file: Callable[[int, int], None] | None
) -> CopyResult:
    if path.exists():
        raise SurveyError(f"{path} exists: choose another file, or remove it")
    total, size, done = _count_files(manifest), len(content), 1
    with _rename_at_end(path) as part:
        with ZipFile(part, "w", ZIP_STORED) as archive:
            archive.writestr(MANIFEST, content)
            for some in _read_in_batches(files, _keys_with_digests(manifest)):
                for key, whole in some.items():
                    archive.writestr(key, whole)
                    size, done = size + len(whole), done + 1
                if on_file:
                    on_file(done, total)
        _require_known_digests(ZipStore(part), _keys_with_digests(manifest))
    return CopyResult(total, size, 0)


def _copy_to_icechunk(
    files: FileSource, manifest: Manifest, path: Path, on_file: Callable[[int, int], None] | None
) -> CopyResult:
    repository = _open_or_create_repository(path)
    session = repository.writable_session(BRANCH)
    # Metadata files come first, from the root group inwards, and chunks last, because the repository refuses a chunk
    # before its array, and an array before its group.
    keys = sorted(_keys_with_digests(manifest), key=lambda file: (not file[0].endswith(ROOT), file[0].count("/")))
    size, done, total = 0, 0, len(keys)
    with asyncio.Runner() as runner:
        for some in _read_in_batches(files, keys):
            runner.run(_write_files(session.store, some))
            size, done = size + sum(map(len, some.values())), done + len(some)
            if on_file:
                on_file(done, total)
        session.commit(f"gear-rattle: {files}")
        _require_known_digests(_CommittedFiles(repository.readonly_session(BRANCH).store, runner), keys)
    return CopyResult(total, size, 0)


def _open_or_create_repository(path: Path) -> icechunk.Repository:
    """Create an Icechunk repository, or open one that has no commit. Raises SurveyError for any other directory."""
    try:
        import icechunk
    except ImportError as error:
        raise MissingExtraError(
            "copies to an Icechunk repository need the package icechunk: pip install 'gear-rattle[icechunk]'"
        ) from error
    icechunk.set_logs_filter("error")  # icechunk would warn of several writers, but a copy has one writer
    storage = icechunk.local_filesystem_storage(str(path))
    try:
        if not path.exists():
            return icechunk.Repository.create(storage)
        repository = icechunk.Repository.open(storage)
        if len(list(repository.ancestry(branch=BRANCH))) == 1:  # only the snapshot with which a repository begins
            return repository
    except icechunk.IcechunkError as error:
        raise SurveyError(
            f"{path} cannot be used as an Icechunk repository ({error}): choose another directory"
        ) from error
    raise SurveyError(f"the Icechunk repository {path} has a commit already: choose another directory, or remove it")


async def _write_files(store: Store, contents: dict[str, bytes]) -> None:
    from zarr.buffer import cpu

    for key, content in contents.items():
        await store.set(key, cpu.Buffer.from_bytes(content))


class _CommittedFiles:
    """The files that a copy has committed to an Icechunk repository, read by key in the event loop of `runner`."""

    def __init__(self, store: Store, runner: asyncio.Runner) -> None:
        self._store, self._runner = store, runner

    def read(self, key: str) -> bytes:
        """Return the content of a file. Raises FileNotFoundError."""
        from zarr.buffer import default_buffer_prototype

        found = self._runner.run(self._store.get(key, default_buffer_prototype()))
        if found is None:
            raise FileNotFoundError(f"the commit on branch {BRANCH} of the Icechunk repository has no {key}")
        return found.to_bytes()


def _require_known_digests(written: FileSource, files: Iterable[tuple[str, tuple[str, ...]]]) -> None:
    """Raise OSError unless each file reads back with an allowed digest. files: key and allowed digests of each."""
    for key, known in files:
        if not _has_known_digest(written, key, known):
            raise OSError(f"{key} does not read back as it was written")


def _read_in_batches(files: FileSource, keys: Iterable[tuple[str, tuple[str, ...]]]) -> Iterator[dict[str, bytes]]:
    """Read the files of a source. keys: key and allowed digests of each file. Raises SurveyError.

    Yields
    ------
    dict[str, bytes]
        The contents of at most BATCH files, by key.
    """
    with ThreadPoolExecutor(READERS) as threads:
        for some in _batches_of_files(keys):
            contents = threads.map(lambda file: _read_with_known_digest(files, *file), some)
            yield {key: content for (key, _), content in zip(some, contents, strict=True)}


def _batches_of_files(files: Iterable[tuple[str, tuple[str, ...]]]) -> Iterator[list[tuple[str, tuple[str, ...]]]]:
    """Yield at most BATCH files at a time; a file is given by its key and its allowed digests."""
    left = iter(files)
    while some := list(islice(left, BATCH)):
        yield some


def _count_files(manifest: Manifest) -> int:
    return 2 + len(manifest.files) + len(manifest.chunks) * len(manifest.tiles)


@contextmanager
def _rename_at_end(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; at the end, rename the file at the temporary path to `path`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
