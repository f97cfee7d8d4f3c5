"""What the host decides about a robot that moves: rules, and graded reactions. Sans-I/O."""

from __future__ import annotations

from bridge.supervise.inputs import Reaction, Watched
from bridge.supervise.settings import Level, SuperviseSettings, parse_rule, settings_from
from bridge.supervise.supervisor import Supervisor

__all__ = [
    "Level",
    "Reaction",
    "SuperviseSettings",
    "Supervisor",
    "Watched",
    "parse_rule",
    "settings_from",
]
