"""Periodic motions as theorems: a finder in ball arithmetic, its certificates, and a checker that shares no code."""
