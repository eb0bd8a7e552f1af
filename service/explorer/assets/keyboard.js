// The map by keys: what is pressed goes to the service, several steps of a key that is held down together.
const map = document.querySelector(".plot")
const STEPS = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1]}
const WORDS = {"+": "closer", "=": "closer", "-": "farther", "0": "all", Enter: "open", Escape: "close", Backspace: "back"}
let steps = [0, 0, 0, 0], waiting = null, number = 0

function send(word) {
  clearTimeout(waiting)
  waiting = null
  keys.data = {steps: [...steps], word: [word], number: [++number]}
  steps = [0, 0, 0, 0]
}

map.addEventListener("keydown", (event) => {
  if (event.composedPath()[0] !== map || event.ctrlKey || event.altKey || event.metaKey) return
  const step = STEPS[event.key], word = event.key === "Backspace" && event.shiftKey ? "forward" : WORDS[event.key]
  if (step == null && word == null) return
  event.preventDefault()
  if (word != null) return send(word)
  const first = event.shiftKey ? 2 : 0
  steps[first] += step[0]
  steps[first + 1] += step[1]
  waiting ??= setTimeout(() => send(""), 40)
})
map.dataset.keys = "heard"
