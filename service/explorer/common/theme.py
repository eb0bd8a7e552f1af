"""Inks of the two themes."""

from __future__ import annotations

INK = {"light": ("#1d2733", "#ffffff", "#c4ccd4"), "dark": ("#e4e9ee", "#171c22", "#47525e")}
