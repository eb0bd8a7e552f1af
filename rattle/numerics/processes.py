"""Start processes that import the same modules as this process, and never from the working directory.

Python first searches the working directory (with ``python -c``, ``python -m`` or at a prompt), or the directory of the
script. If other users can write to that directory, a ``random.py`` there would run their code.
"""

import os
import sys
import sysconfig
from pathlib import Path

#: Environment variable that keeps Python from adding the working directory or the script's directory to `sys.path`.
#: Child processes inherit the variable.
SAFE_PATH = "PYTHONSAFEPATH"


def trusted_import_directories() -> list[str]:
    """Return the directories from which processes of this project import modules.

    Returns
    -------
    list of str
        Absolute entries of ``PYTHONPATH`` and ``sys.path`` in order, without the working directory and the script's
        directory. The directory from which this process loaded the project is always included: directly before the
        first entry that has a copy of the project or, without such a copy, as the last entry. Files in the last entry
        hide no other modules.
    """
    home = str(Path(__file__).parents[2])
    entries = os.environ.get("PYTHONPATH", "").split(os.pathsep) + sys.path
    kept = [
        entry for entry in entries if os.path.isabs(entry) and os.path.realpath(entry) not in _untrusted_directories()
    ]
    others = [place for place, entry in enumerate(kept) if os.path.isdir(os.path.join(entry, "rattle"))]
    kept.insert(min(others, default=len(kept)), home)
    return list(dict.fromkeys(kept))


def child_process_environment() -> dict[str, str]:
    """Return the environment variables of a process that imports from `trusted_import_directories` only."""
    return {**os.environ, SAFE_PATH: "1", "PYTHONPATH": os.pathsep.join(trusted_import_directories())}


def remove_working_directory_from_path() -> None:
    """Let this process, and processes that libraries start, import modules only from `trusted_import_directories`.

    The current directory stays the same; Python no longer searches it, or the script's directory, for modules.
    """
    sys.path[:] = trusted_import_directories()
    os.environ[SAFE_PATH] = "1"


def _untrusted_directories() -> set[str]:
    """Return the working directory and the script's directory, unless they are directories of Python itself."""
    script = getattr(sys.modules.get("__main__"), "__file__", None)
    directories = {os.path.realpath(os.curdir), os.path.realpath(os.path.dirname(script or ""))}
    return directories - {os.path.realpath(path) for path in sysconfig.get_paths().values()}
