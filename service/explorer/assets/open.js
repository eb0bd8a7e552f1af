// The service makes the page only when a browser has loaded and run all scripts: a monitor or a crawler that only reads
// this address leaves no page behind.
async function openPage() {
  // the files of the page have addresses below this one
  if (!location.pathname.endsWith("/")) return location.replace(`${location.pathname}/${location.search}`)
  const headers = {"Rattle-Theme": theme.theme, "Rattle-Address": location.host + location.pathname}
  const answer = await fetch(`page${location.search}`, {headers, cache: "no-store"})
  if (answer.status === 401) return location.reload()  // the reloaded address asks for a key
  if (!answer.ok) {
    const problem = await answer.json().catch(() => null)
    throw new Error(problem?.detail ?? `The service, or a proxy before it, answers with status ${answer.status}.`)
  }
  document.body.append(document.createRange().createContextualFragment(await answer.text()))
}

openPage().catch((error) => {
  const said = document.querySelector("#early p[role]")
  said.setAttribute("role", "alert")
  said.textContent = `The explorer cannot be opened. ${error.message}`
})
