"""Populations of gears: their request, tiles and store."""
