"""The contact and the flow of the stiff gear, its return map, quiet motion, trajectories."""
