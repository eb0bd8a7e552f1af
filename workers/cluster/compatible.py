"""Whether the workers of an existing cluster have the software of this process."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from typing import Any

from distributed import Client

from gear_rattle.workers.errors import SurveyError

OURS, MODULE = "gear-rattle", "gear_rattle"
#: Other versions of these do not understand each other, or compute other bits.
PACKAGES = (OURS, "dask", "distributed", "numpy", "numba", "llvmlite", "zarr")
SHOWN = 3  # workers that a message names


def require_compatible(client: Client) -> None:
    """Compare versions of this process with those of all workers.

    Raises
    ------
    SurveyError
        A worker lacks this package, or has another version of it, of Python or of a library; the message names both.
    """
    found = client.run(find_spec, MODULE, on_error="return")
    if without := [address for address, spec in found.items() if not isinstance(spec, ModuleSpec)]:
        raise SurveyError(
            f"{_named(without)} cannot import {MODULE}: install it there, in the version of this process, with "
            f"pip install '{OURS}[workers]=={_here(client)}' (and [s3] for stores in a bucket)"
        )
    versions: Any = client.get_versions(packages=list(PACKAGES))
    here = _versions(versions["client"])
    others = {address: _versions(each) for address, each in versions["workers"].items()}
    for name, version in here.items():
        differing = {address: each[name] for address, each in others.items() if each[name] != version}
        if differing:
            theirs = ", ".join(sorted({each or "none" for each in differing.values()}))
            raise SurveyError(
                f"{_named(list(differing))} has {name} {theirs}, and this process has {name} {version or 'none'}: "
                "install the same version on both"
            )


def _here(client: Client) -> str:
    versions: Any = client.get_versions(packages=[OURS])
    return str(versions["client"]["packages"][OURS] or "VERSION")


def _versions(of: Mapping[str, Any]) -> dict[str, str | None]:
    """Return versions by package, of Python the first two numbers."""
    python = ".".join(str(of["host"]["python"]).split(".")[:2])
    return {"Python": python} | {name: of["packages"].get(name) for name in PACKAGES}


def _named(addresses: list[str]) -> str:
    more = f" and {len(addresses) - SHOWN} more" if len(addresses) > SHOWN else ""
    return ("the worker at " if len(addresses) == 1 else "workers at ") + ", ".join(sorted(addresses)[:SHOWN]) + more
