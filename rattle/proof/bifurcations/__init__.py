"""Theorems about points of bifurcation curves and codimension-two points, with a checker of its own."""
