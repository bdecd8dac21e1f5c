"""Sphinx builds the site of these pages, README.md and the generated reference: scripts/docs."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from posixpath import normpath

from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))
import reference  # noqa: E402

import ator_ros  # noqa: E402

project = "ator_ros"
version = release = ator_ros.__version__
copyright = "ator_ros maintainers, Apache-2.0"  # noqa: A001
html_theme = "furo"
html_title = f"ator_ros {version}"
html_show_sphinx = False
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "README"
include_patterns = [
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.rst",
    "docs/*.md",
    "docs/generated/*.md",
    "models/*.md",
]
exclude_patterns = ["[!CRdm]*"]  # folders that Sphinx need not search
highlight_language = "text"
myst_heading_anchors = 4
linkcheck_ignore = [r"http://127\."]
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
default_role = "code"

KINDS = {
    "tutorial": "Tutorials",
    "how": "How to",
    "reference": "Reference",
    "explanation": "Explanation",
}


def navigation() -> str:
    """Return tables of contents by kind: the links in docs/README.md, and generated pages."""
    pages: dict[str, list[str]] = {kind: [] for kind in KINDS}
    kind = ""
    for line in (ROOT / "docs" / "README.md").read_text(encoding="utf-8").splitlines():
        if found := re.match(rf"(?:\| |#+ |\*\*)({'|'.join(KINDS)})", line, re.IGNORECASE):
            kind = found[1].lower()
        if kind:
            pages[kind] += [
                normpath(f"docs/{page}") for page in re.findall(r"\(([\w/.]+)\.md\)", line)
            ]
    pages["reference"] += [f"docs/generated/{name}" for name in reference.PAGES]
    pages["explanation"] += ["CONTRIBUTING", "CHANGELOG"]
    text = "\n```{toctree}\n:hidden:\ndocs/README\n```\n"
    for kind, names in pages.items():
        text += "\n".join(["```{toctree}", ":hidden:", f":caption: {KINDS[kind]}", *names, "```\n"])
    return text


def adapt(_app: Sphinx, page: str, source: list[str]) -> None:
    """Change links to folders and files of GitHub, and add the navigation to the first page."""
    generated = f"]({'' if page.startswith('docs/') else 'docs/'}generated/interfaces.md"
    text = re.sub(r"\]\([./]*ator_interfaces/?\)", f"{generated})", source[0])
    text = re.sub(
        r"\]\([./]*ator_interfaces/\w+/(\w+)\.\w+\)",
        lambda found: f"{generated}#{found[1].lower()})",
        text,
    )

    def without_folder(found: re.Match[str]) -> str:
        return found[1] if (ROOT / page).parent.joinpath(found[2]).is_dir() else found[0]

    text = re.sub(r"\[([^\]]*)\]\(([\w./]+)\)", without_folder, text)
    source[0] = text + navigation() if page == root_doc else text


def finish(app: Sphinx, error: Exception | None) -> None:
    """Lead from index.html to the first page."""
    if error is None and app.builder.name == "html":
        to = f'<meta http-equiv="refresh" content="0; url={root_doc}.html">\n'
        Path(app.outdir, "index.html").write_text(to, encoding="utf-8")


def skip(
    _app: Sphinx, _kind: str, _name: str, member: object, skipped: bool, _options: object
) -> bool:
    """Leave out the fields of named tuples, which the class describes."""
    return skipped or str(member.__doc__).startswith("Alias for field number")


def restore(
    _app: Sphinx, kind: str, _name: str, _item: object, _options: object, lines: list[str]
) -> None:
    """Put back words before a colon, which napoleon takes for the type of an attribute."""
    if kind in ("attribute", "property") and lines and lines[-1].startswith(":type: "):
        lines[0] = f"{lines.pop().removeprefix(':type: ')}: {lines[0]}"


def setup(app: Sphinx) -> None:
    """Generate the reference before Sphinx looks for pages."""
    app.connect("builder-inited", lambda _: reference.write_pages(ROOT / "docs" / "generated"))
    app.connect("source-read", adapt)
    app.connect("autodoc-skip-member", skip)
    app.connect("autodoc-process-docstring", restore, priority=600)  # after napoleon
    app.connect("build-finished", finish)
