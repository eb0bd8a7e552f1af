// Figures are not laid out again for a sheet of paper: they keep their layout of the screen, scaled to the sheet.
// The panel of a point is scaled too, or its figures would be cut off and overlap.
// CSS pixels: width of A4 or US letter without margins, and greatest height of a map; largest scale of a point's panel
const SHEET = 700, TALL = 760, LARGER = 1.3
// The address of the view is printed with the page.
addEventListener("beforeprint", () => {
  const plot = document.querySelector(".plot"), {style} = document.documentElement
  if (plot == null) return
  document.querySelector("header").dataset.address = location.href
  const {width, height} = plot.getBoundingClientRect()
  style.setProperty("--printed-width", `${width}px`)
  style.setProperty("--printed-height", `${height}px`)
  style.setProperty("--printed", Math.min(SHEET / width, TALL / height))
  const beside = parseFloat(getComputedStyle(document.querySelector(".beside")).width)
  style.setProperty("--beside-width", `${beside}px`)
  style.setProperty("--beside", Math.min(LARGER, SHEET / beside))
})
