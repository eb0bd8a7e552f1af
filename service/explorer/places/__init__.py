"""What is there without any survey."""
