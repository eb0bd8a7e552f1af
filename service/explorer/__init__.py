"""The explorer: the web page at `/`, made with Panel and Bokeh, which are imported when a page first needs them."""
