"""The stiff gear's branches of periodic motions, which grazes join; its bifurcation curves; its diagram."""
