// Pictures are not laid out anew for a sheet of paper: they keep their size on the screen, and are printed smaller.
const SHEET = 700  // CSS pixels across A4 or US letter, without margins
// The address of the view is printed with it.
addEventListener("beforeprint", () => {
  const plot = document.querySelector(".plot"), {style} = document.documentElement
  if (plot == null) return
  document.querySelector("header").dataset.address = location.href
  const {width, height} = plot.getBoundingClientRect()
  style.setProperty("--printed-width", `${width}px`)
  style.setProperty("--printed-height", `${height}px`)
  style.setProperty("--printed", Math.min(1, SHEET / width))
})
