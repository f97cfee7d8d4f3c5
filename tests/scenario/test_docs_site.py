"""The documentation site builds without a warning, and a broken link is an error."""

from __future__ import annotations

import shutil
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

DOCS = ROOT / "docs"
PAGES = (
    "first-run",
    "wiring",
    "bench",
    "safety",
    "tuning",
    "troubleshooting",
    "commands",
    "ci",
    "protocol/PROTOCOL",
    "extending",
)


def build(docs: Path, out: Path) -> subprocess.CompletedProcess[str]:
    """Build as `make docs` does, with the check of links, but without writing pages."""
    return subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "dummy", docs, out],
        capture_output=True,
        text=True,
        check=False,
    )


def test_every_page_is_in_the_site_and_every_link_leads_somewhere(tmp_path: Path) -> None:
    done = build(DOCS, tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    built = {
        str(path.relative_to(tmp_path / ".doctrees").with_suffix(""))
        for path in (tmp_path / ".doctrees").rglob("*.doctree")
    }
    assert built >= set(PAGES)
    assert built >= {path.stem for path in DOCS.glob("*.md")}


def test_a_link_that_leads_nowhere_fails(tmp_path: Path) -> None:
    docs = tmp_path / "docs"
    docs.mkdir()
    shutil.copy(DOCS / "conf.py", docs)
    shutil.copy(DOCS / "tuning.md", docs)
    links = ("nowhere.md", "tuning.md#no-such-heading", "../tests/no-such.md")
    lines = "\n".join(f"[gone]({link})" for link in (*links, "tuning.md"))
    (docs / "index.md").write_text(f"# Index\n\n```{{toctree}}\ntuning\n```\n\n{lines}\n")
    done = build(docs, tmp_path / "out")
    assert done.returncode != 0
    for link in links:
        assert link.rpartition("#")[2] in done.stderr
