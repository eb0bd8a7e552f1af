"""Prove points of bifurcation curves and codimension-two points: a finder in balls, and an independent checker."""
