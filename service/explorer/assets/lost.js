// The connection to the service is gone, or ended before the page was here: that is said at once, nothing can be chosen
// any more, and when the service answers the page is opened anew, with the view of its address.
const TRIED = "rattle_tried", MOST = 3  // a page that never arrives, as behind a proxy without websockets, is not tried for ever

function arrived() {
  sessionStorage.removeItem(TRIED)
}

function lost() {
  const page = document.querySelector(".page")
  if (page.inert) return
  page.inert = true
  const tried = Number(sessionStorage.getItem(TRIED)) + 1
  const again = tried <= MOST
  sessionStorage.setItem(TRIED, again ? tried : 0)
  const said = document.createElement("p")
  said.id = "lost"
  said.setAttribute("role", "alert")
  said.textContent = again
    ? "The connection to the service is lost: nothing here changes until it answers again. Then this view comes back by itself."
    : "This page cannot be opened: its websocket (/ws) ends before the page is here. A proxy before the service must pass on "
      + "websockets (nginx: proxy_http_version 1.1; proxy_set_header Upgrade $http_upgrade; proxy_set_header Connection upgrade) "
      + "and the Host header (proxy_set_header Host $http_host). Reload to try again."
  document.body.append(said)
  const ask = async () => {
    const answer = await fetch("v1/health", {cache: "no-store"}).catch(() => null)
    if (answer?.ok) location.reload()
    else setTimeout(ask, 1000)
  }
  if (again) setTimeout(ask, 1000)  // a service that ends may answer a little longer than it listens
}

// Of a connection that ends before its document has come nobody tells the page.
window.WebSocket = class extends WebSocket {
  constructor(...given) {
    super(...given)
    this.addEventListener("close", () => Bokeh.documents.length || lost())
  }
}
