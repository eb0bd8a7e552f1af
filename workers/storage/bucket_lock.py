"""Hold the lock of a store in a bucket, and find out whether its holder has died."""

import os
import socket
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import uuid4

import psutil


def identity() -> dict[str, Any]:
    """Return this process, so that another one on the same machine can tell whether it lives."""
    return {
        "host": socket.gethostname(),
        "boot": _boot(),
        "process": os.getpid(),
        "started": psutil.Process().create_time(),
        "since": datetime.now(UTC).isoformat(timespec="seconds"),
        "run": uuid4().hex,
    }


def _boot() -> str:
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""


def has_died(holder: dict[str, Any]) -> bool:
    """Return whether a process is known to have ended: of another machine, or before a reboot, nothing is known."""
    if not _boot() or (holder["host"], holder["boot"]) != (socket.gethostname(), _boot()):
        return False
    try:
        process = psutil.Process(int(holder["process"]))
        return process.create_time() != holder["started"] or process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True
