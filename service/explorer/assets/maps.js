// Buttons of the maps that are explained. A map that the survey lacks has a disabled button, which says what is missing.
export function render({model}) {
  const root = element("div", {class: "maps"})
  const group = element("div", {role: "group", "aria-label": "Maps"})
  const why = element("p", {role: "status", hidden: true})  // for viewers without a mouse: a title shows only under a mouse pointer
  root.append(group, why)
  const explain = (each) => { why.hidden = !each.missing; why.textContent = each.missing ? each.about : "" }

  let drawn = ""
  const state = () => JSON.stringify([model.buttons, model.chosen])
  function draw() {
    drawn = state()
    const focused = root.getRootNode().activeElement?.textContent
    const press = (each) => { if (!each.missing) model.chosen = each.variable; explain(each) }
    group.replaceChildren(...model.buttons.map((each) => element("button", {
      type: "button", title: each.about, "aria-description": each.about, "aria-disabled": each.missing ? "true" : null,
      "aria-pressed": String(!each.missing && each.variable === model.chosen),
      onclick: () => press(each), onfocus: () => explain(each), onblur: () => explain({}),
    }, each.label)))
    for (const each of group.children) if (each.textContent === focused) each.focus()
  }

  model.on(["buttons", "chosen"], draw)
  draw()
  keep_up(root, () => state() !== drawn, draw)
  return root
}
