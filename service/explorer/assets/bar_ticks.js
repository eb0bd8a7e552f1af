// Numbers beside the colour bar, with just enough digits to differ, because there is room for nine characters.
const shorter = (value, digits) => {
  const size = Math.abs(value)
  if (size === 0) return "0"
  if (size >= 1e-3 && size < 1e5) return String(Number(value.toPrecision(digits)))
  return value.toExponential(digits - 1).replace(/\.?0+e/, "e").replace("e+", "e")
}
let digits = 1
const differ = (digits) => new Set(ticks.map((each) => shorter(each, digits))).size === ticks.length
while (digits < 7 && !(differ(digits) && ticks.every((each) => Math.abs(Number(shorter(each, digits)) - each) <= 1e-3 * Math.abs(ticks[1] - ticks[0])))) digits += 1
return shorter(tick, digits).replaceAll("-", "−")
