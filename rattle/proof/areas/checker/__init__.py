"""The independent checker of proved blocks. It needs this folder, Python and mpmath, and nothing else."""
