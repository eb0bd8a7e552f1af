"""Populations of gears that differ within tolerances: the request, the tiles and the store of a population."""
