// The page has the theme that its address asks for, or that of the system, which a cookie tells the service.
const theme = {theme: THEME, asked: ASKED, dark: matchMedia("(prefers-color-scheme: dark)")}
theme.system = () => theme.dark.matches ? "dark" : "light"
theme.follow = () => {
  if (theme.asked || theme.system() === theme.theme) return
  const said = `COOKIE=${theme.system()}`
  document.cookie = `${said}; path=/; max-age=31536000; samesite=strict`
  if (document.cookie.split("; ").includes(said)) location.reload()
}
theme.change = () => {
  const there = new URL(location), other = theme.theme === "dark" ? "light" : "dark"
  if (other === theme.system()) there.searchParams.delete("theme")
  else there.searchParams.set("theme", other)
  location = there
}
theme.dark.addEventListener("change", theme.follow)
theme.follow()
