"""What a survey is and what a cell holds: the folder whose every byte `code_version` hashes."""
