"""What a cell holds: the registry of variables, and how each follows from an evaluation of the cells."""
