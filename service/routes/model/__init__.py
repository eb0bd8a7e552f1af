"""The routes that need no survey: parameter points, curves, basins, machines."""
