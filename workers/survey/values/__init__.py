"""Contents of a cell: the registry of variables, and how each follows from an evaluation of the cells."""
