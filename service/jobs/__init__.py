"""Run surveys and populations in a thread, and locate their stores."""
