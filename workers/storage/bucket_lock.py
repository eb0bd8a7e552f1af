"""Identify the holder of a lock in a bucket, and find out whether it has died."""

import os
import socket
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import uuid4

import psutil


def process_identity() -> dict[str, Any]:
    """Return the identity of this process, from which another process can find out whether this process has ended."""
    return {
        "host": socket.gethostname(),
        "boot": _read_boot_id(),
        "process": os.getpid(),
        "started": psutil.Process().create_time(),
        "since": datetime.now(UTC).isoformat(timespec="seconds"),
        "run": uuid4().hex,
    }


def _read_boot_id() -> str:
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""


def has_lock_holder_died(holder: dict[str, Any]) -> bool:
    """Return whether the process that holds a lock has certainly ended.

    holder: the identity of the process, from `process_identity`.

    Returns
    -------
    bool
        False if the process runs. False also if nothing is known about it, for example because it began on another
        machine, or before the last restart of this machine.
    """
    if not _read_boot_id() or (holder["host"], holder["boot"]) != (socket.gethostname(), _read_boot_id()):
        return False
    try:
        process = psutil.Process(int(holder["process"]))
        return process.create_time() != holder["started"] or process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True
