"""The classifier of the impacting gear, its families of attractors, and the boundary distance."""
