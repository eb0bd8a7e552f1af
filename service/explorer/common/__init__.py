"""Parts that all rooms of the explorer share: address, texts, figures, glyphs, job status, page session."""
