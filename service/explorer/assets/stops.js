// Corrects the elements that the Tab key stops at. Bokeh lets it stop at every figure, though no key acts on a figure.
// Bokeh gives no name to the button that opens the rest of a toolbar, nor to the handle of a slider, and shows the
// chosen button of a row by its colour alone.
{
  const mend = (root) => {
    for (const each of root.querySelectorAll(".bk-events[tabindex]")) each.removeAttribute("tabindex")
    for (const each of root.querySelectorAll(".bk-tool-overflow:not([role])")) {
      each.setAttribute("role", "button")
      each.setAttribute("aria-label", "more tools")
    }
    for (const each of root.querySelectorAll(".bk-btn-group:has(> .bk-btn:nth-child(2)) > .bk-btn")) {
      const chosen = String(each.classList.contains("bk-active"))
      if (each.getAttribute("aria-pressed") !== chosen) each.setAttribute("aria-pressed", chosen)
    }
    for (const each of root.querySelectorAll(".noUi-handle:not([aria-labelledby])")) {
      const title = root.querySelector(".bk-slider-title")
      if (title == null) continue
      title.id = "title"  // unique within this shadow root
      each.setAttribute("aria-labelledby", "title")
    }
  }
  const attach = Element.prototype.attachShadow
  Element.prototype.attachShadow = function (options) {
    const root = attach.call(this, options)
    new MutationObserver(() => mend(root)).observe(root, {childList: true, subtree: true, attributeFilter: ["class"]})
    return root
  }
}
