"""Pseudo-arclength continuation, curves in the plane, the search for branches, sweeps, diagrams. Knows no gear."""
