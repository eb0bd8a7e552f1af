// The page has the theme that its address asks for, or that of the system, which a cookie tells the service. At a first
// visit there is none: then the service waits for a word, and no page of the other theme is ever shown.
const theme = {asked: ASKED, dark: matchMedia("(prefers-color-scheme: dark)")}
theme.system = () => theme.dark.matches ? "dark" : "light"
theme.theme = THEME || theme.system()
document.documentElement.dataset.theme = theme.theme
theme.keep = () => {
  const said = `COOKIE=${theme.system()}`
  document.cookie = `${said}; path=/; max-age=31536000; samesite=strict`
  return document.cookie.split("; ").includes(said)
}
theme.follow = () => {
  if (!theme.asked && theme.system() !== theme.theme && theme.keep()) location.reload()
}
theme.change = () => {
  const there = new URL(location), other = theme.theme === "dark" ? "light" : "dark"
  if (other === theme.system()) there.searchParams.delete("theme")
  else there.searchParams.set("theme", other)
  location = there
}
theme.dark.addEventListener("change", theme.follow)
if (THEME) theme.follow()
else {
  theme.keep()
  fetch("/scheme?page=PAGE&scheme=" + theme.theme)
  addEventListener("DOMContentLoaded", () => {  // made without that word, which was too late
    theme.theme = document.querySelector(".page")?.dataset.theme ?? theme.theme
    theme.follow()
  })
}
