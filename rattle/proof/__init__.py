"""Theorems about motions of the gear: a finder in ball arithmetic, certificates, and a checker that shares no code."""
