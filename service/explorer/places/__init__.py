"""Show closed-form results without any survey."""
