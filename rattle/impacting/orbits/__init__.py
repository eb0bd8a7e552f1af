"""Orbits A–D in closed form, regions, G1 and G2; any P(m, n₊, n₋) from the times of its impacts."""
