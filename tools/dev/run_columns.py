"""The table of the library's columns in docs/runs.md: ``python -m tools.dev.run_columns``."""

from __future__ import annotations

from pathlib import Path

from bridge.library.columns import COLUMNS
from tools.cli.console import write_line
from tools.dev.pages import with_part

PATH = Path(__file__).parents[2] / "docs" / "runs.md"


def with_columns(text: str) -> str:
    """Return the page with the present table."""
    rows = ["| column | type | meaning |", "| --- | --- | --- |"]
    rows += [f"| `{c.name}` | {c.kind} | {c.meaning} |" for c in COLUMNS]
    return with_part(text, "columns", "\n".join(rows) + "\n")


def main() -> None:
    """Write the page."""
    PATH.write_text(with_columns(PATH.read_text("utf-8")), "utf-8")
    write_line(f"wrote {PATH}")


if __name__ == "__main__":
    main()
