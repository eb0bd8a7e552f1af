"""Resilience: how attractors fare along a path of parameters, and the shock that each one bears."""
