"""The names of a store's files, and the checksums by which each is known to be whole and in its place."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

ROOT = "zarr.json"
GROUP = "checksums"
TILES = f"{GROUP}/tiles"
OWN = f"{GROUP}/{ROOT}"
SEALED = (ROOT, OWN)
SEAL = "checksum"
SLICES = "slices"  # the group of what slices along a third axis have beside their cells
SLICE = "{slice}"  # in a key of chunks: the index along a third axis
TILE_KEY = f"{TILES}/c/0/{{row}}/{{column}}"


def path_of(along: tuple[int, ...], group: str = "") -> str:
    """Where a slice has a group: below SLICES and its index along the third axis, if there is one."""
    return "/".join([*(f"{SLICES}/{index}" for index in along), *([group] if group else [])])


def chunk_key(pattern: str, row: int, column: int, rows: int) -> str:
    """Where a chunk of a tile is; of several slices, each with so many rows of tiles, row counts through."""
    along, row = divmod(row, rows) if SLICE in pattern else (0, row)
    return pattern.format(slice=along, row=row, column=column)


def checksum(key: str, content: bytes) -> bytes:
    """Return eight bytes that depend on where a file is and on what it holds."""
    return hashlib.blake2b(content, digest_size=8, key=hashlib.blake2b(key.encode()).digest()).digest()


def sealed(document: Mapping[str, Any]) -> bytes:
    """Return a JSON document of metadata with its own checksum among its attributes."""
    attributes = {**document.get("attributes", {}), SEAL: seal_of(document)}
    return json.dumps({**document, "attributes": attributes}).encode()


def seal_of(document: Mapping[str, Any]) -> str:
    attributes = {name: value for name, value in document.get("attributes", {}).items() if name != SEAL}
    canonical = json.dumps({**document, "attributes": attributes}, sort_keys=True)
    return hashlib.sha256(canonical.encode()).hexdigest()


def tile_key(row: int, column: int) -> str:
    """Where the checksums of a tile are."""
    return TILE_KEY.format(row=row, column=column)


def checksums_of(row: int, column: int, keys: Mapping[str, str], contents: Mapping[str, bytes]) -> np.ndarray:
    """Return the checksums of a tile's chunks and one of these, as the store holds them: (variables + 1, 1, 1)."""
    noted = b"".join(checksum(key, contents[name]) for name, key in keys.items())
    noted += checksum(tile_key(row, column), noted)
    return np.frombuffer(noted, "<u8").reshape(-1, 1, 1)


def checksums_in(stored: bytes, key: str, count: int) -> list[bytes] | None:
    """Return the checksums that a chunk holds, which is not compressed; None if it is lost or damaged."""
    noted, own = stored[: 8 * count], stored[8 * count : 8 * count + 8]
    if checksum(key, noted) != own:
        return None
    return [noted[start : start + 8] for start in range(0, 8 * count, 8)]


def files_of(template: Mapping[str, bytes]) -> dict[str, str]:
    """Return the checksum of each file of a template but the sealed ones, by its key."""
    return {key: checksum(key, content).hex() for key, content in template.items() if key not in SEALED}
