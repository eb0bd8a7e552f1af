// Key of the map: the meanings of its colours and lines, with a check box for each line.
function element(tag, attributes = {}, ...children) {
  const found = document.createElement(tag)
  for (const [name, value] of Object.entries(attributes)) if (value != null) found.setAttribute(name, value)
  found.append(...children.filter((child) => child != null))
  return found
}

const share = (value) => value >= 0.0995 ? `${Math.round(100 * value)} %` : value > 0 ? `${(100 * value).toPrecision(2)} %` : ""

function line(overlay) {
  const swatch = element("span", {class: "line", "aria-hidden": "true"})
  swatch.innerHTML = `<svg width="28" height="10"><line x1="1" x2="27" y1="5" y2="5" stroke="white" stroke-width="4"/>
    <line x1="1" x2="27" y1="5" y2="5" stroke="${overlay.colour}" stroke-width="2" stroke-dasharray="${overlay.dash.join(" ")}"/></svg>`
  return swatch
}

const ring = () => {
  const swatch = element("span", {class: "line", "aria-hidden": "true"})
  swatch.innerHTML = `<svg width="28" height="12"><circle cx="14" cy="6" r="4" fill="white" stroke="black"/></svg>`
  return swatch
}

export function render({model}) {
  const root = element("div", {class: "key"})
  const shades = element("ul", {"aria-label": "colours of the map"})
  const overlays = element("fieldset", {}, element("legend", {}, "Lines"))
  const lines = element("div", {class: "lines"})
  overlays.append(lines)
  const meaning = element("p", {hidden: ""})  // for viewers without a mouse: a title shows only under a mouse pointer
  root.append(shades, overlays, meaning)

  let shown = ""
  function draw_shades() {
    shown = JSON.stringify(model.shades)
    shades.hidden = model.shades.length === 0
    shades.replaceChildren(...model.shades.map((each) =>
      element("li", {}, element("span", {class: "swatch", style: `background:${each.colour}`, "aria-hidden": "true"}),
        each.label, element("small", {}, share(each.share)))))
  }

  function draw_lines() {
    const focused = root.getRootNode().activeElement?.value
    lines.replaceChildren(...model.overlays.map((each) => {
      const box = element("input", {type: "checkbox", value: each.name})
      box.checked = model.chosen.includes(each.name)
      box.addEventListener("change", () => {
        const kept = model.chosen.filter((name) => name !== each.name)
        model.chosen = box.checked ? [...kept, each.name] : kept
      })
      box.addEventListener("focus", () => {
        meaning.hidden = !box.matches(":focus-visible") && matchMedia("(hover: hover)").matches
        meaning.textContent = `${each.label}: ${each.meaning}`
      })
      box.addEventListener("blur", () => { meaning.hidden = true })
      box.setAttribute("aria-description", each.meaning)
      return element("label", {title: each.meaning, class: each.missing ? "missing" : null}, box,
        each.name === "points" ? ring() : line(each), each.label, each.note ? element("small", {}, each.note) : null)
    }))
    if (focused) lines.querySelector(`input[value="${focused}"]`)?.focus()
  }

  const tick = () => lines.querySelectorAll("input").forEach((box) => { box.checked = model.chosen.includes(box.value) })
  model.on("chosen", tick)
  model.on("shades", draw_shades)
  model.on("overlays", draw_lines)
  draw_shades()
  draw_lines()
  // Panel does not report changes of a component while it builds the component: draw these changes later.
  const late = setInterval(() => {
    if (!root.isConnected) clearInterval(late)
    else if (JSON.stringify(model.shades) !== shown) draw_shades()
  }, 500)
  return root
}
