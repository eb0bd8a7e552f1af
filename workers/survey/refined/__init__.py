"""Tiles whose cells are computed coarsely first, and finely where motions differ; other cells are filled."""
