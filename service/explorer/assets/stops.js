// Stops of the Tab key: Bokeh makes one of every picture, which no key does anything with, and gives no name to what
// opens the rest of a row of tools.
{
  const mend = (root) => {
    for (const each of root.querySelectorAll(".bk-events[tabindex]")) each.removeAttribute("tabindex")
    for (const each of root.querySelectorAll(".bk-tool-overflow:not([role])")) {
      each.setAttribute("role", "button")
      each.setAttribute("aria-label", "more tools")
    }
  }
  const attach = Element.prototype.attachShadow
  Element.prototype.attachShadow = function (options) {
    const root = attach.call(this, options)
    new MutationObserver(() => mend(root)).observe(root, {childList: true, subtree: true})
    return root
  }
}
