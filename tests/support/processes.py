"""``sweepctl`` as another process: the command, its environment, and what came of it."""

from __future__ import annotations

import json
import os
import sys
from typing import Any, NamedTuple

from support.root import ROOT

COMMAND = (sys.executable, "-m", "tools.sweepctl")


def environment(**more: str) -> dict[str, str]:
    """Ours, in which another process finds our modules."""
    return {**os.environ, "PYTHONPATH": str(ROOT), **more}


class Done(NamedTuple):
    """A finished command."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        """The one object on stdout, which holds nothing else."""
        assert self.out.endswith("}\n"), self.out
        value = json.loads(self.out, parse_constant=_not_json)
        assert isinstance(value, dict)
        return value

    @property
    def line(self) -> str:
        """The one line that a person is told."""
        assert "Traceback" not in self.err, self.err
        lines = self.err.strip().splitlines()
        assert len(lines) == 1, self.err
        return lines[0]

    @property
    def complaint(self) -> str:
        """The last line that a person is told."""
        return self.err.strip().splitlines()[-1]


def _not_json(name: str) -> float:
    raise AssertionError(f"{name} is no JSON")
