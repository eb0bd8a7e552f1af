"""The directory for a cluster's temporary files. The directory of a killed process is removed at the next start."""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress

PREFIX = "rattle-workers-"
HELD = "held"  # name of a file that the directory's owner keeps locked; the system unlocks it when the owner ends


@contextmanager
def scratch_directory(root: str | None) -> Iterator[str]:
    """Remove directories of killed runs; make a directory that no other account can enter, and remove it at the end.

    Parameters
    ----------
    root : str or None
        Parent directory; by default the system's directory for temporary files.

    Yields
    ------
    str
        Path of the directory.
    """
    _remove_abandoned_directories(root or tempfile.gettempdir())
    with tempfile.TemporaryDirectory(prefix=PREFIX, dir=root, ignore_cleanup_errors=True) as path:
        new = os.path.join(path, f"{HELD}.new")
        file = os.open(new, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            # If the file system has no locks, the file HELD does not appear, and no other run removes the directory.
            with suppress(OSError):
                fcntl.flock(file, fcntl.LOCK_EX)
                os.rename(new, os.path.join(path, HELD))  # renamed after locking, so that no process sees it unlocked
            yield path
        finally:
            os.close(file)


def _remove_abandoned_directories(root: str) -> None:
    with suppress(OSError), os.scandir(root) as entries:
        for entry in entries:
            if entry.name.startswith(PREFIX) and entry.is_dir(follow_symlinks=False):
                with suppress(OSError):  # keep directories of other accounts and directories in use; some may be gone
                    _remove_unless_locked(entry.path)


def _remove_unless_locked(path: str) -> None:
    """Remove the directory at `path` if it belongs to this account. Raises OSError if a running process uses it.

    A process locks the file HELD of a directory while it uses the directory.
    """
    if os.lstat(path).st_uid != os.getuid():
        return
    file = os.open(os.path.join(path, HELD), os.O_RDWR | os.O_NOFOLLOW)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(path, ignore_errors=True)
    finally:
        os.close(file)
