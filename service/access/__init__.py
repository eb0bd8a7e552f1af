"""Control access: keys, origins, login, and the end of open connections after a revocation."""
