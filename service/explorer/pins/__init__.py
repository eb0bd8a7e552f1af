"""Pinned points, whose results stand side by side in a table."""
