"""The commands of ``rattle``, a file for each. Slow imports are inside functions, so that ``--help`` is quick."""
