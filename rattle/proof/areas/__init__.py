"""Prove claims about all points of a block of the plane: a finder in balls, and an independent checker."""
