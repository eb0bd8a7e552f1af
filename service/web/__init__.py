"""Processing of every HTTP answer."""
