// The page has the theme that its address names, else the theme of the viewer's system.
const theme = {dark: matchMedia("(prefers-color-scheme: dark)"), asked: new URLSearchParams(location.search).get("theme")}
theme.isAsked = ["light", "dark"].includes(theme.asked)
theme.system = () => theme.dark.matches ? "dark" : "light"
theme.theme = theme.isAsked ? theme.asked : theme.system()
document.documentElement.dataset.theme = theme.theme
theme.change = () => {
  const there = new URL(location), other = theme.theme === "dark" ? "light" : "dark"
  if (other === theme.system()) there.searchParams.delete("theme")
  else there.searchParams.set("theme", other)
  location = there
}
theme.dark.addEventListener("change", () => {
  if (!theme.isAsked && theme.system() !== theme.theme) location.reload()
})
