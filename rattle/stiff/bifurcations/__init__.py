"""The stiff gear's branches of periodic motions, joined at grazes; its bifurcation curves; its diagram."""
