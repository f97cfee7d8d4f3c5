"""Result of checking a robot or room file: every problem and every warning, one per line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from tools.cli.console import inform, print_error, write_json

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

_T = TypeVar("_T")
INVALID = 2
"""Exit status for a file that cannot be used."""


@dataclass(frozen=True, slots=True)
class Findings:
    """Errors in a file, and values that are likely to cause problems."""

    file: str
    problems: Sequence[str]
    warnings: Sequence[str]

    @classmethod
    def of(
        cls,
        file: Path | str,
        load: Callable[[], _T],
        warnings: Callable[[_T], Sequence[str]],
    ) -> Findings:
        """Load a file and collect its problems; if there are none, collect its warnings."""
        from bridge.errors import ConfigError

        try:
            loaded = load()
        except ConfigError as error:
            return cls(str(file), error.problems, ())
        return cls(str(file), (), tuple(warnings(loaded)))

    def print(self, *, as_json: bool) -> int:
        """Print the findings and return the exit status."""
        status = INVALID if self.problems else 0
        for text in self.problems:
            print_error(text if self.file in text else f"{self.file}: {text}")
        for text in self.warnings:
            inform(f"{self.file}: warning: {text}")
        if as_json:
            write_json(
                {
                    "file": self.file,
                    "valid": not self.problems,
                    "problems": list(self.problems),
                    "warnings": list(self.warnings),
                    "exit_status": status,
                }
            )
        elif not self.problems:
            count = len(self.warnings)
            inform(f"{self.file}: valid, {count} warning{'' if count == 1 else 's'}")
        return status
