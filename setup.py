"""Where the packages go: in a wheel `service` and `workers` stand inside `gear_rattle`, and are imported from there.

Names as general as these would hide other people's modules, or be hidden by them (docs/decisions/0029-names.md). All
else is in pyproject.toml.
"""

import re
import sys
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

HOME, MOVED = "gear_rattle", ("service", "workers")
OURS = "|".join(MOVED)
IMPORT = re.compile(rf"^(\s*)import ({OURS})(?=\s|$)", re.MULTILINE)
FROM = re.compile(rf"^(\s*from )({OURS})(?=[.\s])", re.MULTILINE)
NAMED = re.compile(rf"""(["'])({OURS})([.:]\w+(?:\.\w+)*)\1""")  # "workers.cluster.runner", "service:migrations"
BOUND = re.compile(rf"^\s*import ({OURS})\.", re.MULTILINE)  # what follows would say `workers.` all over


def moved(source: str) -> str:
    """Return a module's source as it is in a wheel."""
    if BOUND.search(source):
        raise ValueError("`import service.x` cannot be moved: write `from service import x`")
    source = IMPORT.sub(rf"\1from {HOME} import \2", source)
    source = FROM.sub(rf"\g<1>{HOME}.\2", source)
    return NAMED.sub(rf"\1{HOME}.\2\3\1", source)


class BuildMoved(build_py):
    """Copy modules, and in them the new names; and the documents as they are, where the site is not built."""

    def run(self) -> None:
        super().run()
        if not Path("service/help/index.html").is_file():
            for source in (path for kind in ("md", "png", "svg", "webp") for path in Path("docs").rglob(f"*.{kind}")):
                self.copy_file(str(source), str(self._made(Path(self.build_lib, HOME, "service/help"), source)))

    def _made(self, where: Path, source: Path) -> Path:
        found = where / source.relative_to("docs")
        self.mkpath(str(found.parent))
        return found

    def build_module(self, module: str, module_file: str, package: str) -> tuple[str, bool]:
        outfile, copied = super().build_module(module, module_file, package)
        text = Path(module_file).read_text(encoding="utf-8")
        if (now := moved(text)) != text:
            Path(outfile).write_text(now, encoding="utf-8")
        return outfile, copied


def packages_of(*names: str) -> list[str]:
    return find_packages(include=[f"{name}{below}" for name in names for below in ("", ".*")])


if "editable_wheel" in sys.argv:  # the checkout as it is
    layout = {"packages": packages_of("rattle", HOME, *MOVED)}
else:
    inner = {f"{HOME}.{name}": name.replace(".", "/") for name in packages_of(*MOVED)}
    layout = {
        "packages": [*packages_of("rattle", HOME), *inner],
        "package_dir": inner,
        "cmdclass": {"build_py": BuildMoved},
    }

setup(package_data={"*": ["assets/*", "help/**/*", "py.typed"]}, **layout)
