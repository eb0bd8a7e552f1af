"""The names of a store's files, and its manifest, which lists a digest of each file so that damage is noticed."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

ROOT = "zarr.json"  # key of the file with the metadata of the whole store
MANIFEST = "manifest.json"  # key of the manifest's file
FORMAT = 1  # version of the manifest's format
DIGITS = 16  # hexadecimal digits of a digest
SLICES = "slices"  # group whose subgroups have the curves, points and families of the slices along a third axis
SLICE = "{slice}"  # placeholder in a pattern of chunk keys for the index along a third axis


def group_path(along: tuple[int, ...], group: str = "") -> str:
    """Return the path of a slice's group: slices/INDEX/GROUP, or only GROUP in a survey without a third axis.

    along: the index of the slice; () without a third axis. group: "" for the group of the slice itself.

    Returns
    -------
    str
        Path in the store.
    """
    return "/".join([*(f"{SLICES}/{index}" for index in along), *([group] if group else [])])


def chunk_key(pattern: str, row: int, column: int, rows: int) -> str:
    """Return the key of a tile's chunk. `row` counts through all slices; each slice has `rows` rows of tiles."""
    along, row = divmod(row, rows) if SLICE in pattern else (0, row)
    return pattern.format(slice=along, row=row, column=column)


def digest(content: bytes) -> str:
    """Return the hexadecimal digest of a file's content, which the manifest keeps under the file's key."""
    return hashlib.blake2b(content, digest_size=DIGITS // 2).hexdigest()


@dataclass(frozen=True)
class Manifest:
    """The files of a store and their digests. Only the process that leads a run writes the manifest.

    A tile counts as computed when `tiles` lists its chunks.
    """

    content_hash: str
    date_created: str
    grid: tuple[int, int]  # numbers of tiles along (epsilon, delta), with the rows of all slices together
    chunks: dict[str, str]  # {variable: pattern of its chunk keys, with {row} and {column}}
    root: tuple[str, ...]  # digest of the file ROOT; while the file is being replaced, its old and new digests
    files: dict[str, str]  # {key: digest} of each file except the root and the chunks of tiles
    tiles: dict[int, str] = field(default_factory=dict)  # {index of a computed tile: joined digests of its chunks}
    slices: int = 1  # number of slices along a third axis

    def to_bytes(self) -> bytes:
        """Return the content of the manifest's file: a JSON document that begins with the SHA-256 of its remainder."""
        written = json.dumps({"format": FORMAT, **vars(self), "tiles": dict(sorted(self.tiles.items()))})
        return f'{{"sha256": "{hashlib.sha256(written.encode()).hexdigest()}", "manifest": {written}}}'.encode()

    @classmethod
    def from_bytes(cls, content: bytes) -> "Manifest | None":
        """Return the manifest in the content of a file, or None if the file is damaged or has another format."""
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
    def tile_rows_per_slice(self) -> int:
        """Number of rows of tiles in a slice."""
        return self.grid[0] // self.slices

    @property
    def n_tiles(self) -> int:
        """Number of tiles, in all slices together."""
        return self.grid[0] * self.grid[1]

    def chunk_keys(self, index: int) -> dict[str, str]:
        """Return {variable: key of its chunk} for the tile with this index."""
        row, column = divmod(index, self.grid[1])
        return {name: chunk_key(key, row, column, self.tile_rows_per_slice) for name, key in self.chunks.items()}

    def record_tile(self, index: int, files: Mapping[str, str]) -> None:
        """Record that a tile is computed. files: {key: digest} of the tile's chunks."""
        self.tiles[index] = "".join(files[key] for key in self.chunk_keys(index).values())

    def digests_of_tile(self, index: int) -> dict[str, str]:
        """Return {key: digest} of a tile's chunks; empty if the tile is not computed."""
        joined = self.tiles.get(index, "")
        each = (joined[i : i + DIGITS] for i in range(0, len(joined), DIGITS))
        return dict(zip(self.chunk_keys(index).values(), each, strict=False))

    def tile_index_of(self, key: str) -> int | None:
        """Return the index of the tile to which the chunk with this key belongs; None if the file is no such chunk."""
        pattern = self.chunks.get(key.rpartition("/c/")[0], "")
        places = dict(zip(pattern.split("/"), key.split("/"), strict=False))
        along, row, column = (places.get(part, "0") for part in (SLICE, "{row}", "{column}"))
        if not all(part.isdecimal() and len(part) < 10 for part in (along, row, column)):
            return None
        i, j = int(along) * self.tile_rows_per_slice + int(row), int(column)
        known = i < self.grid[0] and j < self.grid[1] and chunk_key(pattern, i, j, self.tile_rows_per_slice) == key
        return i * self.grid[1] + j if known else None


def file_digests(files: Mapping[str, bytes]) -> dict[str, str]:
    """Return {key: digest} of files. files: their contents by key."""
    return {key: digest(content) for key, content in files.items()}
