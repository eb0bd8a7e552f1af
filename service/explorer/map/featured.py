"""Maps with a button of their own, and a line for each that says how to read it."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

from gear_rattle.workers.pictures.look import LARGEST


class FeaturedMap(NamedTuple):
    """A map with a button; variables: those that show it, the best first."""

    button: str
    variables: tuple[str, ...]
    meaning: str


FEATURED = (
    FeaturedMap(
        "Quiet",
        ("quiet_fraction",),
        "Yellow: the gear runs quietly from most starts. Dark: it rattles. Click anywhere for its motions.",
    ),
    FeaturedMap(
        "Motions", (LARGEST, "attractor_kind"), "The motion that most starts end in. Click anywhere to see all of them."
    ),
    FeaturedMap(
        "Chaos",
        ("lyapunov_max", "chaotic_fraction"),
        "How fast two nearly equal rattling motions part: chaotic where the exponent is above 0, periodic below.",
    ),
    FeaturedMap(
        "Loudness",
        ("worst_level",),
        "Energy of the loudest motion's impacts: 0 dB is one impact a revolution, +10 dB ten times its energy.",
    ),
    FeaturedMap(
        "Regions",
        ("region",),
        "Which motions with one impact a revolution (A to D) exist: none in I, A and C in II; see Help for the others.",
    ),
)


def featured_in(names: Collection[str]) -> dict[str, str]:
    """Return the variables that have a button, by its text, of those that a survey has."""
    found = {each.button: next((name for name in each.variables if name in names), None) for each in FEATURED}
    return {button: name for button, name in found.items() if name is not None}


def meaning_of(variable: str) -> str:
    """Return how to read a map; nothing for a map without a button."""
    return next((each.meaning for each in FEATURED if variable in each.variables), "")
