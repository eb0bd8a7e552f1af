"""The names of a store's files, and its manifest: the digest of each file, by which it is known to be whole."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

ROOT = "zarr.json"
MANIFEST = "manifest.json"
FORMAT = 1  # of the manifest
DIGITS = 16  # hexadecimal, of a digest
SLICES = "slices"  # the group of what slices along a third axis have beside their cells
SLICE = "{slice}"  # in a key of chunks: the index along a third axis


def group_path(along: tuple[int, ...], group: str = "") -> str:
    """Return the path of a group of a slice: below SLICES and its index along the third axis, if there is one."""
    return "/".join([*(f"{SLICES}/{index}" for index in along), *([group] if group else [])])


def chunk_key(pattern: str, row: int, column: int, rows: int) -> str:
    """Return the key of a chunk of a tile; of several slices, each with so many rows of tiles, row counts through."""
    along, row = divmod(row, rows) if SLICE in pattern else (0, row)
    return pattern.format(slice=along, row=row, column=column)


def digest(key: str, content: bytes) -> str:
    """Return hexadecimal digits that depend on where a file is and on what it holds."""
    return hashlib.blake2b(content, digest_size=DIGITS // 2, key=hashlib.blake2b(key.encode()).digest()).hexdigest()


@dataclass(frozen=True)
class Manifest:
    """Files of a store and their required contents. Only the process that leads a run writes it.

    A tile is computed once its chunks are in `tiles`.
    """

    content_hash: str
    date_created: str
    grid: tuple[int, int]  # tiles along (epsilon, delta), rows of all slices
    chunks: dict[str, str]  # key of the chunks of each variable that tiles write, with {row} and {column}
    root: tuple[str, ...]  # digest of the root's metadata; of the old and of the new while it is replaced
    files: dict[str, str]  # digest of every other file that no tile writes, by its key
    tiles: dict[int, str] = field(default_factory=dict)  # of each computed tile the digests of its chunks, joined
    slices: int = 1  # along a third axis

    def to_bytes(self) -> bytes:
        """Return the file: a JSON document that holds the SHA-256 of the rest of it."""
        written = json.dumps({"format": FORMAT, **vars(self), "tiles": dict(sorted(self.tiles.items()))})
        return f'{{"sha256": "{hashlib.sha256(written.encode()).hexdigest()}", "manifest": {written}}}'.encode()

    @classmethod
    def of_bytes(cls, content: bytes) -> "Manifest | None":
        """Return the manifest that a file holds; None if it is damaged, or of another format."""
        try:
            known: dict[str, Any] = json.loads(content)["manifest"]
            if known.pop("format") != FORMAT:
                return None
            rows, columns = known.pop("grid")
            tiles = {int(index): files for index, files in known.pop("tiles").items()}
            found = cls(grid=(rows, columns), root=tuple(known.pop("root")), tiles=tiles, **known)
            return found if found.to_bytes() == content else None
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return None

    @property
    def rows(self) -> int:
        """Rows of tiles of a slice."""
        return self.grid[0] // self.slices

    @property
    def n_tiles(self) -> int:
        """Tiles of all slices."""
        return self.grid[0] * self.grid[1]

    def keys(self, index: int) -> dict[str, str]:
        """Return the keys of the chunks of a tile, by variable."""
        row, column = divmod(index, self.grid[1])
        return {name: chunk_key(key, row, column, self.rows) for name, key in self.chunks.items()}

    def note(self, index: int, files: Mapping[str, str]) -> None:
        """Enter a computed tile, from the digests of its chunks by their keys."""
        self.tiles[index] = "".join(files[key] for key in self.keys(index).values())

    def digests_of(self, index: int) -> dict[str, str]:
        """Return the digests of the chunks of a tile by their keys; empty unless it is computed."""
        joined = self.tiles.get(index, "")
        each = (joined[i : i + DIGITS] for i in range(0, len(joined), DIGITS))
        return dict(zip(self.keys(index).values(), each, strict=False))

    def tile_of(self, key: str) -> int | None:
        """Return the index of the tile that has this chunk; None if it is no chunk of a tile."""
        pattern = self.chunks.get(key.rpartition("/c/")[0], "")
        places = dict(zip(pattern.split("/"), key.split("/"), strict=False))
        along, row, column = (places.get(part, "0") for part in (SLICE, "{row}", "{column}"))
        if not all(part.isdecimal() and len(part) < 10 for part in (along, row, column)):
            return None
        i, j = int(along) * self.rows + int(row), int(column)
        known = i < self.grid[0] and j < self.grid[1] and chunk_key(pattern, i, j, self.rows) == key
        return i * self.grid[1] + j if known else None


def digests(files: Mapping[str, bytes]) -> dict[str, str]:
    """Return the digest of each of these files, by its key."""
    return {key: digest(key, content) for key, content in files.items()}
