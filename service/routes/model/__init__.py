"""Routes about the model, without a survey: points, curves, basins, machines."""
