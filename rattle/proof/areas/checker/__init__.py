"""The checker of blocks, which trusts nobody: it needs this folder alone, and besides Python only mpmath."""
