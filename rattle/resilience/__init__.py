"""How attractors fare along a path of parameters, and how much of a shock each one bears."""
