"""Replace letters that a terminal or file cannot show by similar ones: Σ⁺ and Σ⁻ become S+ and S- in ASCII."""

from __future__ import annotations

import codecs

NEAREST_LETTERS = "rattle-nearest"  # name of the error handler for `str.encode`
LETTERS = str.maketrans("αβγδεκλμµντφΓΔΛΣΦΩ⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹ⁿ−–—×·", "abgdekluuntfGDLSFO+-0123456789n---x.") | str.maketrans(
    {"…": "...", "→": "->", "±": "+-", "≤": "<=", "≥": ">=", "≠": "!=", "≈": "~", "√": "sqrt ", "∞": "inf", "°": " deg"}
)


def _replace_letters(error: UnicodeError) -> tuple[str, int]:
    """Return the replacement for letters that an encoding lacks, and the position after them in the text."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end].translate(LETTERS)
    return text.encode("ascii", "replace").decode(), error.end


codecs.register_error(NEAREST_LETTERS, _replace_letters)
