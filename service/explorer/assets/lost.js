// If the connection to the service is lost, or ends before the page has loaded, a message says so and the page takes no
// input. When the service answers again, the page is reloaded with the view of its address.
// most reloads of a page that never loads, for example behind a proxy without websockets
const TRIED = "rattle_tried", MOST = 3

function arrived() {
  sessionStorage.removeItem(TRIED)
}

function lost() {
  if (document.querySelector("#lost")) return
  for (const part of document.querySelectorAll(".page nav, .page section")) part.inert = true  // headings stay readable
  const tried = Number(sessionStorage.getItem(TRIED)) + 1
  const again = tried <= MOST
  sessionStorage.setItem(TRIED, again ? tried : 0)
  const said = document.createElement("p")
  said.id = "lost"
  said.setAttribute("role", "alert")
  said.textContent = again
    ? "The connection to the service is lost: nothing here changes until the service answers again. Then this view comes back by itself."
    : "This page cannot be opened: its websocket (/ws) ends before the page is loaded. A proxy before the service must pass on "
      + "websockets (nginx: proxy_http_version 1.1; proxy_set_header Upgrade $http_upgrade; proxy_set_header Connection upgrade) "
      + "and the Host header (proxy_set_header Host $http_host). Reload to try again."
  document.body.append(said)
  const ask = async () => {
    const answer = await fetch("v1/health", {cache: "no-store"}).catch(() => null)
    if (answer?.ok) location.reload()
    else setTimeout(ask, 1000)
  }
  if (again) setTimeout(ask, 1000)  // a service that shuts down may still answer after it has closed the connection
}

// Bokeh does not report a connection that ends before its document has loaded.
window.WebSocket = class extends WebSocket {
  constructor(...given) {
    super(...given)
    this.addEventListener("close", () => Bokeh.documents.length || lost())
  }
}
