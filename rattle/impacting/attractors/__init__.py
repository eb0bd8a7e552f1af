"""The classifier of the impacting gear, its plane of states, the boundary distance."""
