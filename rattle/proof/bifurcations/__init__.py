"""Points of bifurcation curves, and those where curves meet, as theorems; and a checker that shares no code."""
