// Table of the pinned points side by side, with buttons that add, open and remove points.
export function render({model}) {
  const root = element("div", {class: "pins"})
  const send = (action, pin) => () => model.send_msg({action, pin})
  const head = (label, pin) => element("th", {scope: "col"},
    element("button", {type: "button", "data-action": "go", title: "Look closer at this point", onclick: send("go", pin)}, label),
    element("button", {type: "button", "data-action": "remove", "aria-label": `take ${label} away`, onclick: send("remove", pin)}, "×"))

  let drawn = ""
  const state = () => JSON.stringify([model.offered, model.heads, model.lines])
  function draw() {
    drawn = state()
    const {offered, heads, lines, csv} = model
    root.hidden = !offered && !heads.length
    const stops = () => [...root.querySelectorAll("a, button")]
    const focused = stops().indexOf(root.getRootNode().activeElement)
    const table = heads.length ? element("div", {class: "scrolled", tabindex: 0, role: "group", "aria-label": "table of the pinned points"},
      element("table", {}, element("caption", {}, "Pinned points"),
        element("thead", {}, element("tr", {}, element("td"), ...heads.map(head))),
        element("tbody", {}, ...lines.map(([name, ...cells]) =>
          element("tr", {}, element("th", {scope: "row"}, name), ...cells.map((cell) => element("td", {}, cell))))))) : null
    root.replaceChildren(...[
      element("div", {class: "actions"},
        offered ? element("button", {type: "button", class: "quiet", "data-action": "pin", onclick: send("pin", 0)}, `Pin ${offered}`) : null,
        heads.length ? element("a", {href: `data:text/csv;charset=utf-8,${encodeURIComponent(csv)}`, download: "points.csv"}, "CSV") : null),
      table].filter((each) => each != null))
    if (focused >= 0) (stops()[focused] ?? stops()[0])?.focus()
  }

  model.on(["offered", "heads", "lines", "csv"], draw)
  draw()
  keep_up(root, () => state() !== drawn, draw)
  return root
}
