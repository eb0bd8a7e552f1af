"""What a process has to load yet. Apart: one that is given it loads this module, no more."""

import logging
from pathlib import Path

import rattle


def note_needed(path: Path) -> None:
    """Write down the kernels that a survey needs and this process does not have."""
    needed: list[str] = []
    log = logging.getLogger("rattle.numerics.compile")
    log.setLevel(logging.DEBUG)
    log.addFilter(lambda record: record.msg.startswith("needs") and needed.append(record.args[0]))
    rattle.warm_up()
    path.write_text("\n".join(needed))
