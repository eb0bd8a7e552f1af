"""What every HTTP answer goes through."""
