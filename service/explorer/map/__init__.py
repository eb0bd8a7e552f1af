"""The map: its cells, the lines and marks over them, and the text about a cell."""
