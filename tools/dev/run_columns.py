"""The table of the library's columns in docs/runs.md: ``python -m tools.dev.run_columns``."""

from __future__ import annotations

from pathlib import Path

from bridge.library.columns import COLUMNS
from tools.cli.console import write_line

PATH = Path(__file__).parents[2] / "docs" / "runs.md"
_BEGIN, _END = "<!-- columns: begin -->\n", "<!-- columns: end -->\n"


def with_columns(text: str) -> str:
    """Return the page with the present table."""
    head, _, rest = text.partition(_BEGIN)
    _, _, tail = rest.partition(_END)
    rows = ["| column | type | meaning |", "| --- | --- | --- |"]
    rows += [f"| `{c.name}` | {c.kind} | {c.meaning} |" for c in COLUMNS]
    return head + _BEGIN + "\n".join(rows) + "\n" + _END + tail


def main() -> None:
    """Write the page."""
    PATH.write_text(with_columns(PATH.read_text("utf-8")), "utf-8")
    write_line(f"wrote {PATH}")


if __name__ == "__main__":
    main()
