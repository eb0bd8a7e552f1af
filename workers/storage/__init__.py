"""A directory or a bucket, the store in it, its integrity, and what leaves it."""
