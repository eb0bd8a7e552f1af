// Bokeh reads a CSS value for each property of each line and text that it draws, hundreds of times for a map, and most
// readings make the browser compute all styles of the page again. No style here changes a figure, so Bokeh reads none.
try {
  const {VisualProperties} = Bokeh.require("core/visuals/visual")
  if ("_get_css_value" in VisualProperties.prototype) VisualProperties.prototype._get_css_value = () => ""
} catch { }  // another version of Bokeh still reads CSS values

// A figure is drawn for the first time in a task of its own, not in the one that lays out the page or the point with it.
try {
  const {PlotView} = Bokeh.require("models/plots/plot_canvas")
  const {paint} = PlotView.prototype
  PlotView.prototype.paint = function() {
    if (this.was_put_off) return paint.call(this)
    this.was_put_off = true
    const {port1, port2} = new MessageChannel()  // a timer would be late in a hidden tab
    port1.onmessage = () => { port1.close(); this.is_destroyed || paint.call(this) }
    port2.postMessage(null)
  }
} catch { }
