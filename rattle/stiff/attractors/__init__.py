"""The classifier of the stiff gear, and the families of its attractors."""
