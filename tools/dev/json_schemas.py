"""The table of the JSON Schemas in docs/json.md: ``python -m tools.dev.json_schemas``."""

from __future__ import annotations

import json
from pathlib import Path

from tools.cli.console import write_line
from tools.dev.pages import with_part

PATH = Path(__file__).parents[2] / "docs" / "json.md"


def with_schemas(text: str) -> str:
    """Return the page with the present table."""
    rows = ["| commands | schema | what it describes |", "| --- | --- | --- |"]
    for path in sorted((PATH.parent / "schemas").glob("*.json")):
        schema = json.loads(path.read_text("utf-8"))
        names = ", ".join(f"`{name}`" for name in schema["x-commands"])
        shown = "any command that fails" if names == "`*`" else names or "`--on`"
        rows.append(f"| {shown} | [{path.name}](schemas/{path.name}) | {schema['title']} |")
    return with_part(text, "schemas", "\n".join(rows) + "\n")


def main() -> None:
    """Write the page."""
    PATH.write_text(with_schemas(PATH.read_text("utf-8")), "utf-8")
    write_line(f"wrote {PATH}")


if __name__ == "__main__":
    main()
