"""One name for each term: the glossary holds it, its names in code exist, and documents keep to both."""

import ast
import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
GLOSSARY = (DOCS / "glossary.md").read_text()
OWN_TERMS = 20
DECISION_LINES = 40
#: `rattle paper` writes the first; the second describes code by the names that it has today.
WITHOUT_RULES = {"paper.md", "kernel.md"}
#: Words of an older vocabulary, and the term that replaced each.
REPLACED = {
    r"witness(es)?": "probe",
    r"balls? of capture": "capture region",
    r"footprints?": "visited-cell bitmap",
    r"crowds?": "neighbour test",
    r"starts? (are|is) asked": "requested",
    r"nobody is asked": "no key is needed",
    r"(is|are|was|were) not told": "undecided",
    r"set going": "started",
    r"watch(es|ed)?": "observation",
    r"maps? beside": "comparison map",
}


def rows(section: str) -> list[list[str]]:
    """The rows of the table under a heading of the glossary, without its head."""
    text = GLOSSARY.split(f"## {section}\n")[1].split("\n## ")[0]
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[1:]]


SECTIONS = re.findall(r"^## (.*)$", GLOSSARY, re.MULTILINE)
TERMS = [row[0] for section in SECTIONS for row in rows(section)]


def prose(path: Path) -> str:
    """The text of a document, without code, names in code type and names of the page's controls."""
    text = re.sub(r"^```.*?^```|^    [^\n]*$", "", path.read_text(), flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"`[^`\n]*`|\*[^*\n]+\*|\]\([^)]*\)", "", text)


DOCUMENTS = [
    str(path.relative_to(ROOT))
    for path in sorted([*DOCS.rglob("*.md"), ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md"])
    if path.name not in WITHOUT_RULES and "generated" not in path.parts
]


def test_our_own_terms_are_few() -> None:
    assert 0 < len(rows("Our own terms")) <= OWN_TERMS


def test_a_term_is_defined_once() -> None:
    names = [name.strip() for term in TERMS for name in term.split(",")]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("section", SECTIONS)
def test_names_in_the_glossary_are_names_in_the_project(section: str) -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    folders = ("rattle/", "workers/", "service/")
    files = [ROOT / name for name in listed.splitlines() if name.startswith(folders) and name.endswith(".py")]
    sources = "\n".join(path.read_text() for path in files)
    for row in rows(section):
        for name in re.findall(r"`([^`]+)`", row[2]):
            for word in re.findall(r"[A-Za-z_][\w-]+", name):
                written = word.replace("-", "_") if name.startswith("--") else word
                assert written in sources or (ROOT / name.split()[-1]).exists(), f"{row[0]}: {name}"


@pytest.mark.parametrize("document", DOCUMENTS)
def test_documents_use_the_terms_of_the_glossary(document: str) -> None:
    text = prose(ROOT / document)
    for old, term in REPLACED.items():
        found = re.search(rf"\b{old}\b", text, re.IGNORECASE)
        assert not found, f"{document}: {found and found[0]!r} is {term!r}"


#: A docstring that begins so is an ellipsis: "Of an API key: …", "As `iterate`.", "Which cells …".
ELLIPSES = ("Of", "What", "Whether", "Which", "As", "Where", "Who")
SAME_FILE_NAME = 3  # most files of one name
MOST_SHARED = 60  # names of functions in several modules: those of an interface that the modules share


def modules() -> dict[str, ast.Module]:
    """The modules of the packages, by their paths."""
    paths = [path for room in ("rattle", "workers", "service", "gear_rattle") for path in (ROOT / room).rglob("*.py")]
    own = [path for path in paths if not any(parent.is_symlink() for parent in path.parents)]
    return {str(path.relative_to(ROOT)): ast.parse(path.read_text()) for path in own}


def test_no_docstring_begins_with_an_ellipsis() -> None:
    found = []
    for path, tree in modules().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                text = ast.get_docstring(node) or "-"
                if text.split()[0].strip(",:;") in ELLIPSES:
                    found.append(f"{path}: {text.splitlines()[0]}")
    assert not found


def test_a_class_has_a_name_of_its_own_and_few_functions_share_one() -> None:
    places: dict[tuple[type, str], set[str]] = {}
    for path, tree in modules().items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                kind = ast.ClassDef if isinstance(node, ast.ClassDef) else ast.FunctionDef
                places.setdefault((kind, node.name), set()).add(path)
    shared = {key: paths for key, paths in places.items() if len(paths) > 1}
    assert not {key: paths for key, paths in shared.items() if key[0] is ast.ClassDef}
    assert len([name for kind, name in shared if kind is ast.FunctionDef and not name.startswith("_")]) <= MOST_SHARED


def test_few_files_share_a_name() -> None:
    names = Counter(Path(path).name for path in modules() if not path.endswith("__init__.py"))
    assert not {name: count for name, count in names.items() if count > SAME_FILE_NAME}


@pytest.mark.parametrize("path", sorted(DOCS.glob("decisions/0*.md")), ids=lambda path: path.stem)
def test_a_decision_has_context_decision_and_consequences(path: Path) -> None:
    text = path.read_text()
    assert len(text.splitlines()) <= DECISION_LINES
    assert re.match(rf"# {path.stem[:4]} \S", text)
    if "\nStatus: superseded" not in text:
        assert re.findall(r"^## (.*)$", text, re.MULTILINE) == ["Context", "Decision", "Consequences"]
    title = text.splitlines()[0].removeprefix(f"# {path.stem[:4]} ")
    assert f"- [{path.stem[:4]}]({path.name}): {title}" in (DOCS / "decisions" / "README.md").read_text()
