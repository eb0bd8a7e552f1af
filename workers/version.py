"""Which code fills a survey: a resumed survey must not mix two versions."""

from functools import cache
from hashlib import sha256
from pathlib import Path

import rattle

#: The modules of this package that decide what a cell holds.
_SOURCES = (
    "cells.py",
    "curves.py",
    "evaluate.py",
    "quantities.py",
    "request.py",
    "schema.py",
    "template.py",
    "tiles.py",
)


@cache
def code_version() -> str:
    """Return the version of the library with a digest of every source that decides what a cell holds."""
    digest = sha256(rattle.source_hash().encode())
    for name in _SOURCES:
        digest.update(Path(__file__).with_name(name).read_bytes())
    return f"{rattle.__version__}+{digest.hexdigest()[:16]}"
