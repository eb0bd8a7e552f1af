"""Branches of the stiff gear through grazes, its curves, its diagram."""
