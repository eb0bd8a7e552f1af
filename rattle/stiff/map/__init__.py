"""Contacts and the flow of the stiff gear, its return map, quiet motion, and trajectories."""
