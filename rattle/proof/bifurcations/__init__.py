"""Theorems about points of bifurcation curves and codimension-two points, and a checker that shares no code."""
