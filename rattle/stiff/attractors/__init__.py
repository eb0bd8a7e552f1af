"""The classifier of the stiff gear, and its plane of states."""
