"""The document: routes, websocket, form."""
