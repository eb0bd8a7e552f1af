"""The stiff gear's branches of periodic motions, through grazes; its bifurcation curves; its diagram."""
