"""The site of `make docs`: docs/ as it stands, in the four parts of Diátaxis, with notebooks that are executed."""

import re
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import generate  # noqa: E402 - it lies beside this file

import rattle  # noqa: E402 - after the line above

project, author = "gear-rattle", "The gear-rattle developers"
release = version = rattle.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
exclude_patterns = ["site", "README.md"]
html_theme = "pydata_sphinx_theme"
html_title = f"gear-rattle {release}"
html_theme_options = {"show_prev_next": False, "navigation_with_keys": False, "secondary_sidebar_items": ["page-toc"]}
html_static_path: list[str] = []

# MyST: links to headings, and to files of the repository that are no pages.
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 4
nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE.parents[1] / "build" / "notebooks")
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_merge_streams = True

# Docstrings speak of names in single backticks, whoever has them.
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "NDArray": "NDArray"}
autodoc_default_options = {"members": True, "undoc-members": False}
napoleon_google_docstring, napoleon_numpy_docstring = True, False
# Links to files beside docs/ lead nowhere in the site; that each leads to a file is what a test looks at.
suppress_warnings = ["myst.header", "myst.xref_missing", "ref.python", "toc.not_included"]


def _plain(_app: Any, _what: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    """Docstrings are plain text: |x| and P* are no markup."""
    lines[:] = ["`".join(_escaped(part, i) for i, part in enumerate(line.split("`"))) for line in lines]


def _escaped(part: str, number: int) -> str:
    return part if number % 2 else re.sub(r"([*|])", r"\\\1", part)


def setup(app: Any) -> None:
    """Write what follows from the programs: REST, the command line, the store."""
    app.connect("autodoc-process-docstring", _plain, priority=400)  # before napoleon
    generate.main(HERE.parent / "reference" / "generated")
