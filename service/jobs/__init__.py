"""The thread that runs surveys, and where stores lie."""
