"""The classifier of the inelastic gear."""
