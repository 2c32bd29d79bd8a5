"""What `make docs` tells Sphinx: the repository's own pages, in the order of the manual's index, and a reference.

The pages stay where they are, so that their links work in the repository and in the site. A warning ends the build.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util import logging

ROOT = Path(__file__).parents[2]
INDEX = ROOT / "docs/README.md"
REFERENCE = ("client", "control", "messages", "solver")

project = "fmfts"
author = "the fmfts developers"
extensions = ["myst_parser", "sphinx.ext.autodoc"]
root_doc = "README"
include_patterns = [
    *("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md"),
    *("docs/**.md", "lab/README.md", "lab/results/*.md", "clients/*/README.md", "extras/*/README.md", "firmware/*.md"),
]
exclude_patterns = ["build", ".*", "**/node_modules"]
suppress_warnings = ["myst.header"]  # README begins with its title as HTML, or with a second level
myst_heading_anchors = 6

html_theme = "furo"
html_title = "fmfts"
html_show_sphinx = False
html_copy_source = False
html_static_path: list[str] = []
html_additional_pages = {"index": "to-readme.html"}  # a folder's first page
templates_path = ["templates"]

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_default_options = {"members": True, "undoc-members": True}
log = logging.getLogger(__name__)


def toctree(index: str) -> str:
    """The site's navigation: the manual's index, a caption for each of its sections, and the reference."""
    parts = []
    seen = {"README"}
    for section in re.split(r"^## ", index, flags=re.MULTILINE)[1:]:
        title, _, body = section.partition("\n")
        entries = []
        for target in re.findall(r"\]\(([^)#\s]+\.md)", body):
            page = (INDEX.parent / target).resolve().relative_to(ROOT).with_suffix("").as_posix()
            if page not in seen:
                seen.add(page)
                entries.append(f"/{page}")
        parts.append((title, entries))
    parts.append(("Reference", [f"/docs/site/reference/{name}" for name in REFERENCE]))
    packages = (page for folder in ("clients", "extras") for page in sorted((ROOT / folder).glob("*/README.md")))
    more = [page.relative_to(ROOT).with_suffix("").as_posix() for page in packages]
    parts.append(("More", ["/docs/README", *(f"/{page}" for page in more if page not in seen), "/CHANGELOG"]))
    options = "maxdepth: 1\nhidden:\n"
    return "".join(
        f"\n```{{toctree}}\n---\ncaption: {title}\n{options}---\n" + "\n".join(entries) + "\n```\n"
        for title, entries in parts
    )


def with_navigation(app: Sphinx, page: str, source: list[str]) -> None:
    """The README stays free of what only the site needs."""
    if page == root_doc:
        source[0] += toctree(INDEX.read_text())
    elif page == "lab/results/README":
        names = sorted(path.stem for path in (ROOT / "lab/results").glob("*.md") if path.stem != "README")
        source[0] += "\n```{toctree}\n:hidden:\n" + "\n".join(names) + "\n```\n"


def as_text(app: Sphinx, what: str, name: str, of: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text with code in backticks, not reStructuredText. One that lacks ends the build."""
    ours = getattr(of, "__module__", None) or name
    if what in ("module", "class", "exception", "function") and ours.startswith("fmfts") and not any(lines):
        log.warning("%s has no docstring", name)
    parts = re.split(r"(`[^`]*`)", "\n".join(lines))
    escaped = [f"`{part}`" if part.startswith("`") else re.sub(r"([\\*|_])", r"\\\1", part) for part in parts if part]
    lines[:] = "".join(escaped).split("\n")


def setup(app: Sphinx) -> None:
    app.connect("source-read", with_navigation)
    app.connect("autodoc-process-docstring", as_text)
