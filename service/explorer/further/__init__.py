"""Maps beside the first one, of its window: other variables, other surveys, and differences."""
