"""The explorer: a page at `/` for people who would rather look. Panel and Bokeh, loaded when first needed."""
