"""Resilience: attractors along a path of parameters, and the smallest shocks that make a motion leave its attractor."""
