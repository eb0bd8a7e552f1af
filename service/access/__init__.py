"""Who may: keys, origins, login, and what ends when they are revoked."""
