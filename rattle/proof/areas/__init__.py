"""Theorems about all points of a block of the plane: a finder in balls, and a checker that shares no code with it."""
