"""A tile whose cells are computed coarse first, and finer where what exists there differs; the others are filled."""
