"""Populations of gears that differ within their tolerances."""
