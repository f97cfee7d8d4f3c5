"""What the host decides about a robot that moves: rules, and graded reactions. Sans-I/O."""

from __future__ import annotations

from bridge.supervise.settings import Level, SuperviseSettings, parse_rule, settings_from
from bridge.supervise.supervisor import Supervisor
from bridge.supervise.watched import Reaction, Watched

__all__ = [
    "Level",
    "Reaction",
    "SuperviseSettings",
    "Supervisor",
    "Watched",
    "parse_rule",
    "settings_from",
]
