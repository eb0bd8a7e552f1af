"""Periodic motions of the stiff gear, given by the times and durations of contacts, and the families of A to D."""
