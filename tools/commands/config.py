"""``sweepctl config``: show the settings of the configuration files."""

from __future__ import annotations

import click

from tools.cli import options
from tools.cli.console import plain_console, write_json


@click.group("config", epilog="Example:  sweepctl config show --json")
def command() -> None:
    """Show defaults and named robots of the configuration files.

    `docs/configuration.md` explains the files.
    """


@command.command("show", epilog="Example:  sweepctl config show --json")
@options.json_option
@click.pass_context
def show(ctx: click.Context, *, as_json: bool) -> int:
    """Show each default and each named robot, and the file that it comes from.

    A key is never shown, only the path of its file.
    """
    from dataclasses import fields

    from tools.cli.configuration import Defaults, configuration

    found = configuration(ctx)
    if as_json:
        write_json(
            {
                "files": [{"path": str(path), "exists": there} for path, there in found.files],
                "defaults": {
                    key: {"value": each.value, "source": each.source}
                    for key, each in found.defaults.items()
                },
                "robots": {
                    name: {k: {"value": v.value, "source": v.source} for k, v in robot.items()}
                    for name, robot in found.robots.items()
                },
            }
        )
        return 0
    from rich.table import Table
    from rich.text import Text

    from tools.cli.visible_text import one_line

    table = Table(box=None, pad_edge=False)
    for title in ("key", "value", "from"):
        table.add_column(title, overflow="fold")

    def row(*cells: str) -> None:
        table.add_row(*(Text(one_line(cell)) for cell in cells))

    for path, there in found.files:
        row("file", str(path), "read" if there else "not there")
    for each in fields(Defaults):
        value = found.defaults.get(each.name)
        if value is None:
            row(f"defaults.{each.name}", each.metadata["built_in"], "built-in")
        else:
            row(f"defaults.{each.name}", str(value.value), value.source)
    for name, robot in found.robots.items():
        for key, value in robot.items():
            row(f"robots.{name}.{key}", str(value.value), value.source)
    plain_console().print(table)
    return 0
