// Positions along δ or ε of a machine's round speeds or eccentricities: an eccentricity is proportional to ε, a speed
// to 1/δ.
const first = Math.max(Math.min(cb_data.start, cb_data.end), inverse ? 1e-3 * Math.max(cb_data.start, cb_data.end) : 0)
const last = Math.max(cb_data.start, cb_data.end)
if (!(last > first)) return []
const [low, high] = inverse ? [scale / last, scale / first] : [scale * first, scale * last]
const rounded = []
if (inverse && high > 4 * low) {
  for (let power = Math.floor(Math.log10(low)); 10 ** power <= high; power += 1) {
    for (const digit of [1, 2, 5]) rounded.push(digit * 10 ** power)
  }
} else {
  const rough = (high - low) / 6
  const power = 10 ** Math.floor(Math.log10(rough))
  const step = power * [1, 2, 5, 10].find((each) => each * power >= rough)
  for (let k = Math.ceil(low / step); k * step <= high; k += 1) rounded.push(k * step)
}
const inside = rounded.filter((each) => each >= low && each <= high)
return inside.map((each) => inverse ? scale / each : each / scale)
  .sort((one, other) => one - other)  // rising, also on a reversed range: Bokeh keeps labels apart in this order only
