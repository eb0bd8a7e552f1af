// List of the service's surveys, which is kept up to date, with details and actions of the chosen survey.
const STATES = {accepted: "waiting", running: "running", successful: "done", failed: "failed", dismissed: "cancelled"}

const FEW = 4  // with fewer surveys, the search field is hidden
// Sort key of each order, and true if the largest key comes first. The service sends the newest survey first.
const ORDERS = {
  "newest first": [null], "by name": [(row) => row.name.toLowerCase()],
  "largest first": [(row) => row.size.split(" × ").reduce((cells, along) => cells * along, 1), true],
  "unfinished first": [(row) => row.state === "successful" ? 1 : 0],
}
const compare = (one, other) => one < other ? -1 : one > other ? 1 : 0

function lasting(seconds) {
  if (seconds < 90) return `${Math.max(1, Math.round(seconds))} s`
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`
  return `${(seconds / 3600).toFixed(1)} h`
}

const speed = (rate) => `${rate >= 10 ? Math.round(rate).toLocaleString("en") : rate.toPrecision(2)} cells/s`

function standing(row) {
  if (row.example) return "comes with the explorer"
  const parts = [STATES[row.state]]
  if (row.state === "running") parts[0] = `${row.progress} %`
  if (row.state === "running" && row.message.startsWith("waits for")) parts.push("waiting")  // another survey is being computed
  if (row.rate) parts.push(speed(row.rate))
  if (row.left) parts.push(`${lasting(row.left)} left`)
  if (row.failed) parts.push(`${row.failed} cells failed`)
  return parts.join(" · ")
}

// A row stays the same element while its survey runs, or focus, a press and selected text would be lost.
function row_of(row, choose) {
  return element("li", {}, element("button", {type: "button", "data-survey": row.id, onclick: () => choose(row.id)}))
}

function fill(button, row, is_chosen) {
  const busy = row.state === "running" || row.state === "accepted"
  button.className = `survey ${row.state}${row.example ? " example" : ""}`
  button.dataset.state = row.state
  if (is_chosen) button.setAttribute("aria-current", "true")
  else button.removeAttribute("aria-current")
  button.replaceChildren(
    element("span", {class: "name"}, row.name),
    element("span", {class: "size"}, row.size),
    ...(busy ? [element("progress", {max: 100, value: row.progress, "aria-label": `progress of ${row.name}`})] : []),
    element("span", {class: "standing"}, standing(row)))
}

function lines_of(row, signed_in) {
  const url = new URL(`v1/surveys/${row.id}/store`, document.baseURI)
  const key = signed_in ? `, storage_options={"headers": {"Authorization": "Bearer " + key}}` : ""
  const [axis, number] = row.slice  // empty if the survey has no third axis
  const one = axis ? `.isel(${axis}=${number})` : ""
  return `import xarray as xr\n\nsurvey = xr.open_zarr(\n    "${url}"${key}\n)\nsurvey.${row.variable || "status"}${one}.plot()`
}

// Form that changes the name and the notes of a survey.
function form_of(row, send) {
  const name = element("input", {name: "name", maxlength: 200, value: row.title})
  const notes = element("textarea", {name: "notes", maxlength: 10000, rows: 4})
  notes.value = row.notes
  const close = () => {
    form.hidden = true
    form.previousSibling.querySelector("[data-action=describe]").focus()
    form.dispatchEvent(new Event("closed", {bubbles: true}))
  }
  const form = element("form", {class: "describing", hidden: true, onsubmit: (event) => {
    event.preventDefault()
    close()
    send({name: name.value, notes: notes.value})
  }},
    element("label", {}, "New name", name), element("label", {}, "Notes", notes),
    element("div", {class: "actions"}, element("button", {class: "quiet"}, "Save"),
      element("button", {type: "button", class: "quiet", onclick: close}, "Leave as it is")))
  return form
}

function detail_of(row, model) {
  const here = `v1/surveys/${row.id}`
  const busy = row.state === "running" || row.state === "accepted"
  const act = (action) => () => model.send_msg({action, survey: row.id})
  const facts = element("dl", {}, ...row.facts.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]))
  const again = element("button", {type: "button", class: "quiet", "data-action": "again", onclick: act("again")}, "Use its settings")
  if (row.example) {  // it has no files, and nobody can remove it
    return element("section", {class: "detail", "data-of": row.id, "aria-label": row.name}, facts,
      element("div", {class: "actions"}, again))
  }
  const removing = element("button", {type: "button", class: "quiet", "data-action": busy ? "cancel" : "delete"},
    busy ? "Cancel" : "Delete")
  removing.addEventListener("click", () => {  // a second press confirms, because a deleted survey cannot be restored
    if (busy || removing.dataset.sure) return act(busy ? "cancel" : "delete")()
    removing.dataset.sure = "1"
    removing.textContent = "Delete for good?"
  })
  const describing = form_of(row, (given) => model.send_msg({action: "describe", survey: row.id, ...given}))
  const code = element("pre", {tabindex: 0, "aria-label": "Python lines that open this survey"}, lines_of(row, model.signed_in))
  const copy = element("button", {type: "button", class: "quiet copy", onclick: async () => {
    await navigator.clipboard?.writeText(code.textContent)
    copy.textContent = "Copied"
  }}, "Copy")
  return element("section", {class: "detail", "data-of": row.id, "aria-label": `survey ${row.name}`},
    facts,
    row.message ? element("p", {class: "message"}, row.message) : null,
    row.notes ? element("p", {class: "notes"}, row.notes) : null,
    element("div", {class: "downloads"}, "Download ",
      element("a", {href: `${here}/download.nc`, download: true}, "NetCDF"), " ",
      element("a", {href: `${here}/download.csv`, download: true}, "CSV"), " ",
      ...(row.picture ? ["png", "svg", "pdf"] : []).flatMap((form) => [  // pictures of the map as it is shown
        element("a", {href: `${here}/map.${form}?${row.picture}`, download: `${row.variable}.${form}`}, form.toUpperCase()), " "])),
    element("div", {class: "code"}, copy, code),
    element("div", {class: "actions"},
      again,
      row.mine && row.state === "dismissed"
        ? element("button", {type: "button", class: "quiet", "data-action": "resume", onclick: act("resume")}, "Resume")
        : null,
      row.mine
        ? element("button", {type: "button", class: "quiet", "data-action": "describe", onclick: () => {
            describing.hidden = false
            describing.querySelector("input").focus()
          }}, "Name and notes")
        : null,
      row.mine ? removing : null),
    row.mine ? describing : null)
}

export function render({model}) {
  const root = element("div", {class: "surveys"})
  const list = element("ul", {"aria-label": "surveys"})
  const detail = element("div")
  const empty = element("p", {class: "empty"}, "No surveys yet. Submit one: its map fills in as it is computed.")
  const none = element("p", {class: "empty", role: "status"})
  // Search field and order of the list. Both affect this page only.
  const search = element("input", {type: "search", "aria-label": "search surveys", placeholder: "Search", oninput: () => draw()})
  const order = element("select", {"aria-label": "order of the surveys", onchange: () => draw()},
    ...Object.keys(ORDERS).map((name) => element("option", {}, name)))
  const finding = element("div", {class: "finding"}, search, order)
  root.append(finding, empty, list, none)
  const kept = new Map()  // rows by the id of their survey
  let shown = ""

  let drawn = "", chosen = model.chosen
  const state = () => JSON.stringify([model.rows, model.chosen, model.ready])
  function draw() {
    drawn = state()
    if (chosen && model.chosen !== chosen) root.dispatchEvent(new Event("chosen", {bubbles: true, composed: true}))
    chosen = model.chosen
    const wanted = search.value.trim().toLowerCase()
    const searchable = (row) => [row.name, row.notes, row.size, STATES[row.state], ...row.facts.flat()].join(" ").toLowerCase()
    const own = model.rows.filter((row) => !row.example)
    const rows = own.filter((row) => searchable(row).includes(wanted))
    const [key, falling] = ORDERS[order.value]
    if (key) rows.sort((one, other) => (falling ? -1 : 1) * compare(key(one), key(other)))
    finding.hidden = own.length < FEW
    none.textContent = own.length && !rows.length ? "No survey has this text in its name, notes or settings." : ""
    none.hidden = !none.textContent
    rows.push(...model.rows.filter((row) => row.example))  // the last entry, whatever the order
    const items = rows.map((row) => {
      if (!kept.has(row.id)) kept.set(row.id, row_of(row, (id) => { model.chosen = id }))
      const item = kept.get(row.id)
      fill(item.firstChild, row, row.id === model.chosen)
      return item
    })
    for (const [id, item] of kept) {
      if (items.includes(item)) continue
      item.remove()
      kept.delete(id)
    }
    items.forEach((item, place) => {
      if (list.children[place] !== item) list.insertBefore(item, list.children[place] ?? null)
    })
    empty.hidden = own.length > 0 || !model.ready
    const row = rows.find((each) => each.id === model.chosen)
    const now = row ? JSON.stringify([row.id, row.name, row.notes, row.state, row.message, row.picture, row.mine]) : ""
    const isEdited = row && detail.querySelector(`[data-of="${row.id}"] form:not([hidden])`)
    if (now !== shown && !isEdited) {  // or each computed tile would undo a half-made choice and a text selection
      const stops = () => [...detail.querySelectorAll("a, button, pre")]
      const focused = stops().indexOf(root.getRootNode().activeElement)
      detail.replaceChildren(...(row ? [detail_of(row, model)] : []))
      if (focused >= 0) stops()[focused]?.focus()
      shown = now
    }
    const item = row && kept.get(row.id)
    if (item && detail.parentElement !== item) item.append(detail)
  }

  detail.addEventListener("closed", () => draw())  // draws changes that came while the form was open
  model.on(["rows", "chosen", "ready"], draw)
  draw()
  keep_up(root, () => state() !== drawn, draw)
  return root
}
