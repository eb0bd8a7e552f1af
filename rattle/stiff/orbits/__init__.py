"""Periodic motions of the stiff gear as the times and durations of contacts; the families of A–D."""
