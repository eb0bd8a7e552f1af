"""Measured impacts beside what the model has: of an experiment, or of anybody's simulation."""

from rattle.comparison.compare import Comparison, Near, compare
from rattle.comparison.measured import MeasuredImpacts, measured, read_csv
from rattle.comparison.walls import POOR

__all__ = ["POOR", "Comparison", "MeasuredImpacts", "Near", "compare", "measured", "read_csv"]
