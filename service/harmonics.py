"""Read and write harmonics of the forcing as text, ORDER:AMPLITUDE:PHASE, for URLs and commands."""

from __future__ import annotations

from collections.abc import Iterable

from rattle import ParameterError
from rattle.parameters import Harmonic

SHAPE = "ORDER:AMPLITUDE:PHASE"
EXAMPLE = "20:0.0033:0"
HARMONIC_HELP = (
    f"a harmonic of the forcing beside the first, {SHAPE}: its amplitude over that of the first, its phase in turns, "
    f"such as {EXAMPLE}; repeatable; needs restitution, 1 of which is an elastic impact"
)


def read_harmonics(texts: Iterable[str]) -> tuple[Harmonic, ...]:
    """Return the harmonics that texts ORDER:AMPLITUDE:PHASE describe. Raises ParameterError for other texts."""
    return tuple(_read_harmonic(text) for text in texts)


def harmonic_texts(harmonics: Iterable[Harmonic]) -> list[str]:
    """Return harmonics as texts, from which `read_harmonics` reads the same numbers to the last bit."""
    return [f"{order}:{amplitude!r}:{phase!r}" for order, amplitude, phase in harmonics]


def _read_harmonic(text: str) -> Harmonic:
    try:
        order, amplitude, phase = text.split(":")
        return int(order), float(amplitude), float(phase)
    except ValueError:
        raise ParameterError(f"harmonic {text!r:.80} is not {SHAPE}: write three numbers, such as {EXAMPLE}") from None
