// Bokeh asks the style of the page for each property of each line and text that it draws, hundreds of times for a map,
// and mostly has the whole page's worked out anew by that. No style here says how a picture is drawn.
try {
  const {VisualProperties} = Bokeh.require("core/visuals/visual")
  if ("_get_css_value" in VisualProperties.prototype) VisualProperties.prototype._get_css_value = () => ""
} catch { }  // another Bokeh: it asks
