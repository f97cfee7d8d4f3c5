"""Supervision of a moving robot: rules and graded reactions. Sans-I/O."""

from __future__ import annotations

from bridge.supervise.inputs import Reaction, RuleInputs, limited_command
from bridge.supervise.settings import Level, SuperviseSettings, parse_rule, settings_from
from bridge.supervise.supervisor import Supervisor

__all__ = [
    "Level",
    "Reaction",
    "RuleInputs",
    "SuperviseSettings",
    "Supervisor",
    "limited_command",
    "parse_rule",
    "settings_from",
]
