"""``FILE``: a log on the command line; ``latest`` refers to the newest run."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tools.cli.completion import complete_files
from tools.cli.paths import PathName

if TYPE_CHECKING:
    import click
    from click.shell_completion import CompletionItem

_LATEST = re.compile(r"latest(~\d+)?")


class LogPath(PathName):
    """Parameter type: the path of a log, or ``latest``, ``latest~N`` or ``DIR/latest``."""

    def __init__(self) -> None:
        super().__init__()

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's interface
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> Any:  # noqa: ANN401 - click's interface
        """Convert the text to a path; `latest` and `latest~N` become the path of a recorded run.

        Raises:
            NoRunError: there is no such run.

        """
        path = super().convert(value, param, ctx)
        if ctx is not None and ctx.resilient_parsing:
            return path
        return newest_if_named(path) if isinstance(path, Path) else path

    def shell_complete(
        self,
        ctx: click.Context,  # noqa: ARG002 - click's interface
        param: click.Parameter,  # noqa: ARG002 - click's interface
        incomplete: str,
    ) -> list[CompletionItem]:
        """Return logs, folders, and `latest`."""
        from click.shell_completion import CompletionItem

        return [CompletionItem(name) for name in complete_log(incomplete)]


def newest_if_named(path: Path) -> Path:
    """Return the run that `latest` names; any other path unchanged.

    Raises:
        NoRunError: there is no such run.

    """
    if _LATEST.fullmatch(path.name) is None:
        return path
    from bridge.library.library import resolve

    return resolve(path)


def complete_log(incomplete: str) -> list[str]:
    """Return the logs and folders, and `latest`, whose names begin with ``incomplete``."""
    folder, slash, begun = incomplete.rpartition("/")
    numbered = [f"latest~{n}" for n in range(1, 10)] if begun.startswith("latest") else []
    names = [f"{folder}{slash}{name}" for name in ("latest", *numbered)]
    return [*(n for n in names if n.startswith(incomplete)), *complete_files(incomplete, ".mcap")]
