// Tick labels that differ however narrow the range is. Labels that would need more than about six digits are distances
// from an offset, which the label of the axis names. `tick_label_offset` of service/explorer/design/axes.py writes the same
// offset.
const span = Math.abs(range.end - range.start)
const scale = Math.max(Math.abs(range.start), Math.abs(range.end))
const step = ticks.length > 1 ? Math.abs(ticks[1] - ticks[0]) : span
const places = (value) => Math.min(20, Math.max(0, 1 - Math.floor(Math.log10(value) + 1e-9)))
if (span > 1e-5 * scale) {
  const digits = places(step)
  const fixed = ticks.map((each) => each.toFixed(digits))
  return fixed.every((each) => each.endsWith("0")) && digits > 0 ? tick.toFixed(digits - 1) : tick.toFixed(digits)
}
const offset = Number(((range.start + range.end) / 2).toPrecision(Math.ceil(Math.log10(scale / span)) + 1))
const power = Math.floor(Math.log10(span) + 0.01)
const distance = (tick - offset) / 10 ** power
return (Math.abs(distance) < 1e-6 ? 0 : distance).toFixed(Math.max(0, places(step / 10 ** power) - 1)).replace("-", "−")
