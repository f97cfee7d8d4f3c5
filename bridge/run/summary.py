"""Summary of a run as one JSON object; unknown values are None."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from bridge.session.event_kinds import EventKind
from bridge.session.link_stats import wire_summary
from protocol.messages.values import StopCause, label

if TYPE_CHECKING:
    from bridge.evaluation.metrics import CoverageReport
    from bridge.run.ending import Ending
    from bridge.run.host import Host


_COVERAGES = (
    "mouth_sweepable",
    "mouth_passing",
    "mouth_free",
    "body_reachable",
    "body_free",
    "eq8",
)


def link_summary(host: Host) -> dict[str, Any]:
    """Return :func:`wire_summary` with round-trip time, commands and message types.

    It counts the queued events, so call it in the loop's thread or after the loop's end.
    """
    host.wire.count(host.sync)
    return {
        **wire_summary(host.session.link.statistics),
        "commands": asdict(host.session.command_counts),
        **host.wire.to_dict(),
    }


def run_summary(  # noqa: PLR0913 - the parts of a summary
    host: Host,
    *,
    room: str | None,
    planner: str | None,
    seed: int | None,
    log: str | None,
    report: CoverageReport | None = None,
    error_m: tuple[float | None, float | None] = (None, None),
    collisions: int | None = None,
    contact_s: float | None = None,
    energy_wh: float | None = None,
) -> dict[str, Any]:
    """Return the JSON object of a run, finished or not.

    ``error_m`` is the final and the maximum distance between estimate and truth, m.
    """
    mission = host.mission
    ending = mission.ending
    duration_s = None
    if mission.drive_started_s is not None and mission.drive_ended_s is not None:
        duration_s = round(mission.drive_ended_s - mission.drive_started_s, 3)
    runner = mission.runner
    coverage: dict[str, float | None] = dict.fromkeys(_COVERAGES)
    if report is not None:
        coverage = {key: _round(value) for key, value in report.coverage.to_dict().items()}
    return {
        "room": room,
        "planner": planner,
        "seed": seed,
        "outcome": ending.outcome if ending else "stopped",
        "reason": ending.reason if ending else None,
        "stop_cause": _stop_cause(ending),
        "duration_s": duration_s,
        "path_m": _round(report.path_m if report else _distance_m(host), 3),
        "turns": runner.turns if runner else None,
        "collisions": collisions,
        "contact_s": _round(contact_s, 3),
        "energy_wh": _round(energy_wh),
        "pose_error_m": {
            "end": _round(error_m[0]),
            "max": _round(error_m[1]),
        },
        "start_error": _start_error(host),
        "coverage": coverage,
        "t90_s": _round(report.t90_s if report else None, 2),
        "t99_s": _round(report.t99_s if report else None, 2),
        "largest_hole_cm2": _round(report.largest_hole_cm2 if report else None, 1),
        "hole_inradius_m": _round(report.hole_inradius_m if report else None),
        "repeat_ratio": _round(report.repeat_ratio if report else None),
        "wire": link_summary(host),
        "events": _events(host),
        "log": log,
    }


_UNKNOWN = (
    *("duration_s", "path_m", "turns", "collisions", "contact_s", "energy_wh"),
    *("t90_s", "t99_s", "largest_hole_cm2", "hole_inradius_m", "repeat_ratio"),
)
"""Keys that are None in the summary of a run that failed in the program."""


def crash_summary(
    host: Host, *, room: str | None, planner: str | None, seed: int | None, log: str | None
) -> dict[str, Any]:
    """Return the JSON object of a run that failed in the program: only its end and the link."""
    ending = host.mission.ending
    return {
        "room": room,
        "planner": planner,
        "seed": seed,
        "outcome": "fault",
        "reason": ending.reason if ending else None,
        "stop_cause": _stop_cause(ending),
        **dict.fromkeys(_UNKNOWN),
        "pose_error_m": {"end": None, "max": None},
        "start_error": None,
        "coverage": dict.fromkeys(_COVERAGES),
        "wire": wire_summary(host.session.link.statistics),
        "events": _events(host),
        "log": log,
    }


def _stop_cause(ending: Ending | None) -> str | None:
    """Return the name of the most severe stop at the end; ``session_end``: a normal end."""
    return label(StopCause, ending.gravity) if ending else None


def _start_error(host: Host) -> dict[str, float | None] | None:
    """Return the difference between the real start and the room file's start; None: unknown."""
    fit, plan = host.plausibility.fit, host.plausibility.plan
    if fit is None or plan is None:
        return None
    off_m, off_rad = fit.off(plan.start) if fit.start is not None else (None, None)
    return {
        "wall_share": _round(fit.share),
        "distance_m": _round(off_m, 3),
        "turn_rad": _round(off_rad, 3),
    }


def _events(host: Host) -> dict[str, int]:
    """Count the events that a list of runs shows."""
    counts = host.event_counts
    return {
        "supervise": sum(n for (source, _), n in counts.items() if source == "supervise"),
        "device_faults": counts.get(("device", EventKind.FAULT.value), 0),
    }


def _distance_m(host: Host) -> float | None:
    return None if host.drive_pose is None else host.path_m


def _round(value: float | None, digits: int = 4) -> float | None:
    return None if value is None else round(value, digits)
