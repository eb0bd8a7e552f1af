"""Address, texts, figures, glyphs, theme, news, viewer."""
