"""The view of one clicked point: its attractors, basins, motions, diagram and tolerances."""
