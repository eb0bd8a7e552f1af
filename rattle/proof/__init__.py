"""Theorems about motions: a finder in ball arithmetic, certificates, and a checker that shares no code with it."""
