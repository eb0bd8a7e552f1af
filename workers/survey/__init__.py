"""Define a survey and the contents of a cell: the folder whose every byte `code_version` hashes."""
