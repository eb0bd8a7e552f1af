"""What asks the model, and no survey: points, curves, basins, machines."""
