"""Run surveys in a thread, and locate their stores."""
