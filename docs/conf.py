"""The documentation's build: Sphinx over Markdown (`make docs`)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from sphinx.util.logging import getLogger

if TYPE_CHECKING:
    from sphinx.application import Sphinx

project = "sweepctl"
author = "the sweepctl authors"
project_copyright = "the sweepctl authors, MIT license"
extensions = ["myst_parser", "sphinxcontrib.mermaid"]
source_suffix = {".md": "markdown"}
root_doc = "index"
exclude_patterns = ["_build"]
# Headings can be linked to as on the forges: page.md#a-heading.
myst_heading_anchors = 4
html_theme = "furo"
html_title = "sweepctl"
html_copy_source = False
# Every reference must lead somewhere; with -W one that does not is an error.
nitpicky = True

# The forges draw the same blocks; in the site the reader's browser draws them.
myst_fence_as_directive = ["mermaid"]

_MORE = re.compile(r"^% more.*$", re.MULTILINE)
_BESIDE = re.compile(r"\[([^\]]+)\]\((\.\./[^)#]+\.md)(?:#[^)]*)?\)")


def _source_links(app: Sphinx, docname: str, content: list[str]) -> None:
    """Pages of the source outside of docs/ (a test vector's README) are named, not linked."""
    folder = (Path(app.srcdir) / docname).parent

    def named(found: re.Match[str]) -> str:
        if Path(app.srcdir) in (folder / found[2]).resolve().parents:
            return found[0]  # a page of ours
        if not (folder / found[2]).is_file():
            getLogger(__name__).warning("%s is not there", found[2], location=docname)
        return f"{found[1]} (`{found[2].lstrip('./')}`)"

    content[0] = _BESIDE.sub(named, content[0])
    if docname == "index":
        content[0] = _MORE.sub(_more(Path(app.srcdir), content[0]), content[0])


def _more(docs: Path, index: str) -> str:
    """Return a list of the pages that the index does not name, so that a new page is never lost."""
    listed = {"index", *(line.strip() for line in index.splitlines())}
    pages = [p.relative_to(docs).with_suffix("").as_posix() for p in sorted(docs.rglob("*.md"))]
    left = [page for page in pages if page not in listed]
    head = "```{toctree}\n:caption: More\n:maxdepth: 1\n\n"
    return head + "\n".join(left) + "\n```\n" if left else ""


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", _source_links)
