"""Chaos as a theorem: sets that the impact map stretches across each other, and a checker that shares no code."""
