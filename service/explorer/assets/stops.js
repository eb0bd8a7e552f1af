// Stops of the Tab key: Bokeh makes one of every picture, which no key does anything with, and gives no name to what
// opens the rest of a row of tools, nor to what is moved of a slider. Which button of a row is chosen it shows by a
// colour alone.
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
      title.id = "title"  // in this root alone
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
