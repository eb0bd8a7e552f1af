"""The command line: a file for each command. Heavy imports stay inside the functions, so that ``--help`` is quick."""
