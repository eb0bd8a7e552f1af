"""State of a page: the events that change its view, the reducer, and the store that panels subscribe to."""
