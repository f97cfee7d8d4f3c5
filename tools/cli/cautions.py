"""Warnings about a valid robot or room that is likely to cause problems."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.config import robot_cautions
from bridge.session.event_kinds import EventKind
from bridge.session.records import EventRecord, Severity

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel


def cautions(model: RobotModel, plan: FloorPlan | None) -> list[tuple[str, str]]:
    """Return each caution with its source, ``robot`` or ``room``."""
    found = [("robot", text) for text in robot_cautions(model)]
    if plan is not None:
        found += [("room", text) for text in plan.cautions]
    return found


def caution_lines(model: RobotModel, plan: FloorPlan | None) -> list[str]:
    """Return the cautions as lines to print."""
    return [f"warning: {source}: {text}" for source, text in cautions(model, plan)]


def caution_records(model: RobotModel, plan: FloorPlan | None, log_ns: int) -> list[EventRecord]:
    """Return the cautions as events of a log, at time ``log_ns``."""
    return [
        EventRecord(log_ns, Severity.WARNING, source, EventKind.CAUTION, text, {})
        for source, text in cautions(model, plan)
    ]
