"""Control access: keys, origins, login, and the end of open connections when they are revoked."""
