"""Answers of the high-precision oracles, kept in tests/reference: whatever is asked anew is computed.

`tests/references/make_references.py` writes them, `test_stored.py` computes some of them again.
"""

import json
from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any

from mpmath import mp, mpc, mpf

FILE = Path(__file__).parents[1] / "reference" / "high_precision.json"
DIGITS = 40

#: What is kept, by the name of the oracle and its arguments as JSON.
KEPT: dict[str, dict[str, Any]] = json.loads(FILE.read_text()) if FILE.exists() else {}
#: What this process has asked, kept or not.
ASKED: dict[str, dict[str, Any]] = {}
#: The oracles themselves, by name.
ORACLES: dict[str, Callable[..., Any]] = {}


def plain(value: Any) -> Any:
    """A value in JSON, numbers of high precision to all their digits."""
    if isinstance(value, mpf):
        return {"re": mp.nstr(value, DIGITS)}
    if isinstance(value, mpc):
        return {"re": mp.nstr(value.real, DIGITS), "im": mp.nstr(value.imag, DIGITS)}
    return [plain(x) for x in value] if isinstance(value, (list, tuple)) else value


def read(value: Any) -> Any:
    """The value that was written so."""
    if isinstance(value, dict):
        return mpc(value["re"], value["im"]) if "im" in value else mpf(value["re"])
    return [read(x) for x in value] if isinstance(value, list) else value


def stored(oracle: Callable[..., Any]) -> Callable[..., Any]:
    """Ask the file before the oracle, whose arguments and answers are numbers, texts and lists of them."""
    name = oracle.__name__
    ORACLES[name] = oracle

    @cache
    def known(asked: str) -> Any:
        kept = KEPT.get(name, {})
        answer = kept[asked] if asked in kept else plain(oracle(*read(json.loads(asked))))
        ASKED.setdefault(name, {})[asked] = answer
        return read(answer)

    @wraps(oracle)
    def ask(*arguments: Any) -> Any:
        return known(json.dumps(plain(arguments)))

    return ask


def write() -> None:
    """Write what was asked, one answer a line."""
    lines = [
        json.dumps(name) + ": {\n" + ",\n".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in sorted(answers.items()))
        for name, answers in sorted(ASKED.items())
    ]
    FILE.write_text("{\n" + "\n},\n".join(lines) + "\n}\n}\n")
