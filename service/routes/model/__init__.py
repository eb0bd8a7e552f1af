"""The routes that need no survey: they compute parameter points, curves, basins and machines."""
