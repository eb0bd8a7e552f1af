"""Resilience: attractors along a path of parameters, fatal shocks, edge states, tipping, and times of convergence."""
