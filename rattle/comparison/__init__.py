"""Compare measured impacts, of an experiment or another simulation, with the attractors of a gear."""

from rattle.comparison.compare import ComparedAttractor, Comparison, compare
from rattle.comparison.measured import MeasuredImpacts, measured, read_csv
from rattle.comparison.walls import POOR

__all__ = ["POOR", "ComparedAttractor", "Comparison", "MeasuredImpacts", "compare", "measured", "read_csv"]
