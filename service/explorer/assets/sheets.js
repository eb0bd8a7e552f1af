// Where the page is narrow, the list of surveys and the controls of the map are folded until somebody opens them, and
// an open point is a sheet at the lower edge of the screen.
const ABOVE = 40  // pixels between the point that was tapped and the sheet
const narrow = matchMedia("(max-width: 899px)")
function fold() {
  for (const each of document.querySelectorAll("details.fold")) each.open = !narrow.matches
}
narrow.addEventListener("change", fold)
document.addEventListener("chosen", () => {  // a survey was chosen: its map comes into view
  if (!narrow.matches) return
  fold()
  document.querySelector(".middle").scrollIntoView()
})

const sheet = {
  tapped: 0,  // pixels from the upper edge of the screen to the tapped point
  watch() {
    const beside = document.querySelector(".beside")
    document.querySelector(".plot").addEventListener("pointerup", (event) => { sheet.tapped = event.clientY }, {capture: true})
    new ResizeObserver(() => {  // the point that was tapped stays in view while the sheet grows
      if (getComputedStyle(beside).position !== "fixed" || beside.classList.contains("tall")) return
      const before = scrollY
      scrollBy(0, Math.max(0, sheet.tapped - beside.getBoundingClientRect().top + ABOVE))
      sheet.tapped -= scrollY - before
    }).observe(beside)
  },
  grow(button) {
    const is_tall = document.querySelector(".beside").classList.toggle("tall")
    button.setAttribute("aria-expanded", is_tall)
    button.textContent = is_tall ? "Less" : "More"
  },
  close: () => document.querySelector(".plot").dispatchEvent(new KeyboardEvent("keydown", {key: "Escape"})),
}
