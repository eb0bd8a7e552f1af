"""Address, texts, glyphs, theme, news, viewer."""
