"""Identify the code that computes a survey, because a continued survey must not mix numbers of two code versions."""

from functools import cache
from hashlib import sha256
from pathlib import Path

import rattle

FOLDERS = ("survey", "populations")  # folders of `workers` whose files decide the contents of a store


@cache
def code_version() -> str:
    """Return the version of the library, with a digest of all source files that decide the contents of a store.

    These are the files of the package `rattle` and of the folders `survey` and `populations`.

    Returns
    -------
    str
        For example "1.0+0123456789abcdef": the version, and 16 hexadecimal digits of the digest.
    """
    digest = sha256(rattle.source_hash().encode())
    for folder in FOLDERS:
        room = Path(__file__).parents[1] / folder
        for path in sorted(room.rglob("*.py")):
            digest.update(path.relative_to(room).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return f"{rattle.__version__}+{digest.hexdigest()[:16]}"
