"""Replacements of letters for terminals and files without them: Σ⁺ and Σ⁻ are S+ and S- in ASCII, not ``??``."""

from __future__ import annotations

import codecs

NEAREST = "rattle-nearest"  # an error handler, as `str.encode` takes it
LETTERS = str.maketrans("αβγδεκλμµντφΓΔΛΣΦΩ⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹ⁿ−–—×·", "abgdekluuntfGDLSFO+-0123456789n---x.") | str.maketrans(
    {"…": "...", "→": "->", "±": "+-", "≤": "<=", "≥": ">=", "≠": "!=", "≈": "~", "√": "sqrt ", "∞": "inf", "°": " deg"}
)


def _nearest(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end].translate(LETTERS)
    return text.encode("ascii", "replace").decode(), error.end


codecs.register_error(NEAREST, _nearest)
