"""Blocks of the plane on which something is proved as a whole: a finder in balls, and a checker that shares no code."""
