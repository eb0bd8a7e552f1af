"""Contents of a cell: the registry of variables, and their computation from an evaluation of the cells."""
