"""The web page itself: its routes, its websocket, its document and the form for a new survey."""
