"""Resilience: attractors along a path of parameters, and the smallest shocks that end them."""
