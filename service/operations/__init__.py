"""The operations that routes and the explorer share."""
