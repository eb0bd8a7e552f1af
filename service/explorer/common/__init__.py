"""Parts that all rooms of the explorer share: address, texts, figures, glyphs, theme, job status, page session."""
