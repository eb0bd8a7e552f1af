// The connection to the service is gone: that is said at once, nothing can be chosen any more, and when the service
// answers again the page is opened anew, with the view of its address.
const page = document.querySelector(".page")
if (!page.inert) {
  page.inert = true
  const said = document.createElement("p")
  said.id = "lost"
  said.setAttribute("role", "alert")
  said.textContent = "The connection to the service is lost: nothing here changes until it answers again. Then this view comes back by itself."
  document.body.append(said)
  const ask = async () => {
    const answer = await fetch("/v1/health", {cache: "no-store"}).catch(() => null)
    if (answer?.ok) location.reload()
    else setTimeout(ask, 1000)
  }
  setTimeout(ask, 1000)  // a service that ends may answer a little longer than it listens
}
