"""``sweepctl`` in another process: the command, its environment, and its result."""

from __future__ import annotations

import json
import os
import sys
from typing import Any, NamedTuple

from support.root import ROOT

COMMAND = (sys.executable, "-m", "tools.sweepctl")


def environment(**more: str) -> dict[str, str]:
    """Return the environment for another process that imports the project's modules."""
    return {**os.environ, "PYTHONPATH": str(ROOT), **more}


class Done(NamedTuple):
    """A finished command."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        """The only object on stdout."""
        assert self.out.endswith("}\n"), self.out
        value = json.loads(self.out, parse_constant=_not_json)
        assert isinstance(value, dict)
        return value

    @property
    def line(self) -> str:
        """Return the only line of the text output."""
        assert "Traceback" not in self.err, self.err
        lines = self.err.strip().splitlines()
        assert len(lines) == 1, self.err
        return lines[0]

    @property
    def complaint(self) -> str:
        """Return the last line of the text output."""
        return self.err.strip().splitlines()[-1]


def _not_json(name: str) -> float:
    raise AssertionError(f"{name} is no JSON")
