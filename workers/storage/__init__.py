"""Directories and buckets, the stores in them, their integrity, and copies and exports."""
