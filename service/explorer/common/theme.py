"""Colours of the light and of the dark theme: text, background and lines."""

from __future__ import annotations

INK = {"light": ("#1d2733", "#ffffff", "#c4ccd4"), "dark": ("#e4e9ee", "#171c22", "#47525e")}
