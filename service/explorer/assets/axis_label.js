// Writes the offset of the tick labels, as ticks.js computes it, into the label of the axis.
const span = Math.abs(range.end - range.start)
const scale = Math.max(Math.abs(range.start), Math.abs(range.end))
let label = name
if (span > 0 && span <= 1e-5 * scale) {  // the span is 0 for a moment while a range is reversed
  const digits = Math.ceil(Math.log10(scale / span)) + 1
  const offset = Number(((range.start + range.end) / 2).toPrecision(digits))
  label = `${name} − ${offset}, in units of 1e${Math.floor(Math.log10(span) + 0.01)}`
}
if (axis.axis_label !== label) axis.axis_label = label
