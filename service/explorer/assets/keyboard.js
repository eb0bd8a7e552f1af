// Keyboard control of the map. Commands go to the service, and several steps of a key that is held down go together.
const map = document.querySelector(".plot")
const STEPS = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1]}
const WORDS = {"+": "closer", "=": "closer", "-": "farther", "0": "all", Enter: "open", Escape: "close", Backspace: "back"}
const SHIFTED = {Backspace: "forward", Enter: "through"}
let steps = [0, 0, 0, 0], waiting = null, number = 0

function send(word) {
  clearTimeout(waiting)
  waiting = null
  number += 1  // columns of one length
  keys.data = {steps: [...steps], word: Array(4).fill(word), number: Array(4).fill(number)}
  steps = [0, 0, 0, 0]
}

map.addEventListener("keydown", (event) => {
  if (event.composedPath()[0] !== map || event.ctrlKey || event.altKey || event.metaKey) return
  const step = STEPS[event.key], word = (event.shiftKey && SHIFTED[event.key]) || WORDS[event.key]
  if (step == null && word == null) return
  event.preventDefault()
  if (word != null) return send(word)
  const first = event.shiftKey ? 2 : 0
  steps[first] += step[0]
  steps[first + 1] += step[1]
  waiting ??= setTimeout(() => send(""), 40)
})
// A click on a link that names a point, for example an event of a diagram, opens this point.
document.addEventListener("click", (event) => {
  const link = event.composedPath().find((each) => each.dataset?.point)
  if (link == null || event.ctrlKey || event.metaKey || event.shiftKey) return
  event.preventDefault()
  send(`point ${link.dataset.point}`)
})
map.dataset.keys = "heard"
