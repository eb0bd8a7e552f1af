"""Which attractor a state goes to; basins, and how they intermingle. Knows no gear."""
