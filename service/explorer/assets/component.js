// Functions that the components of the page share. This file is put before the script of each component.
function element(tag, attributes = {}, ...children) {
  const found = document.createElement(tag)
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) found.addEventListener(name.slice(2), value)
    else if (value === true) found.setAttribute(name, "")
    else if (value !== false && value != null) found.setAttribute(name, value)
  }
  found.append(...children.filter((child) => child != null))
  return found
}

// Panel does not report changes of a component while it builds the component: draw these changes later.
function keep_up(root, is_late, draw) {
  const late = setInterval(() => {
    if (!root.isConnected) clearInterval(late)
    else if (is_late()) draw()
  }, 500)
}

