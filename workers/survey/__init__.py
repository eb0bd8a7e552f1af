"""Define a survey and the contents of a cell. `code_version` hashes every byte of this folder."""
