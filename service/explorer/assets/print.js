// Pictures are not laid out anew for a sheet of paper: they keep their size on the screen, and are printed as large as a
// sheet. So does what is known of a point, or its pictures would be cut off and lie over each other.
const SHEET = 700, TALL = 760, LARGER = 1.3  // CSS pixels across A4 or US letter, without margins, and of a map
// The address of the view is printed with it.
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
