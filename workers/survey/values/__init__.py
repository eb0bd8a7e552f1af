"""The contents of a cell: the registry of the stored variables, and the computation of their values."""
