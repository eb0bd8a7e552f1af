"""Prove chaos by sets that the impact map stretches across each other: a finder, and an independent checker."""
