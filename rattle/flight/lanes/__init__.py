"""Many flights in step, in the lanes of a processor's vectors."""
