"""Theorems about all points of a block of the plane: a finder in ball arithmetic, and an independent checker."""
