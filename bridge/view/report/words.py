"""Text of a report: title, summary in sentences, and highlighted values."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from bridge.record.names import VIRTUAL_PORT
from bridge.view.report.page import Tile

if TYPE_CHECKING:
    from bridge.view.report.run_data import RunData

_GOOD, _FAIR = 0.98, 0.90
_ENDINGS = {
    "complete": "was completed",
    "stopped": "was stopped before it was complete",
    "timeout": "reached its time limit",
    "fault": "ended with a fault",
}


def title(data: RunData) -> str:
    """Return room, planner and seed in one line."""
    summary, metadata = data.summary, data.metadata
    room = summary.get("room") or (data.track.plan.name if data.track.plan else None)
    planner = summary.get("planner") or metadata.get("planner")
    parts = [f"Sweeping {room}" if room else data.track.name]
    if planner:
        parts.append(f"planner {planner}")
    seed = summary.get("seed", metadata.get("seed"))
    if seed is not None:
        parts.append(f"seed {seed}")
    return ", ".join(str(part) for part in parts)


def when(data: RunData) -> str:
    """Return date and time of the start, UTC. For a simulation they have no meaning."""
    if not data.start_ns:
        return "an empty log"
    if data.metadata.get("port") == VIRTUAL_PORT:
        return "Simulated in virtual time; the clock starts at the same date in every run"
    moment = datetime.fromtimestamp(data.start_ns / 1e9, tz=UTC)
    return f"{moment:%Y-%m-%d %H:%M:%S} UTC"


def summary_sentences(data: RunData) -> list[str]:
    """Return the summary of the run in sentences."""
    summary, report = data.summary, data.coverage
    lines = []
    outcome, reason = summary.get("outcome"), summary.get("reason")
    if outcome:
        ending = _ENDINGS.get(str(outcome), f"ended as “{outcome}”")
        line = f"The run {ending}"
        lines.append(f"{line}: {reason}." if reason else f"{line}.")
    elif not data.whole:
        lines.append(
            "The end of the log is missing: it is still being written, or its writer was killed or "
            "lost power. The rest was read."
        )
    else:
        lines.append("The log does not contain the outcome of the run.")
    duration_s, path_m = data.figure("duration_s"), data.figure("path_m")
    if duration_s is not None and path_m is not None:
        lines.append(f"It took {_minutes(duration_s)}; the path is {path_m:.1f} m long.")
    if report is not None:
        share = report.coverage.mouth_sweepable
        basis = "by the true path" if data.track.truth else "by the estimated path"
        lines.append(
            f"The robot swept {100 * share:.1f} % of the {report.sweepable_m2:.2f} m² that its "
            f"mouth can reach, {basis}. The largest unswept piece has "
            f"{report.largest_hole_cm2:.0f} cm²."
        )
        lines.append(
            f"This robot needs at least {_minutes(report.min_time_s)} to sweep that floor: "
            f"always at its top speed of {data.track.model.max_speed_m_s:.2f} m/s, and without "
            "sweeping any floor twice."
        )
        if share >= _FAIR:  # the ratio of a stopped run is misleading
            lines.append(
                f"The reference time, lanes at cruise speed without turns or overlap, is "
                f"{_minutes(report.reference_time_s)}. The run took {report.time_ratio:.2f} times "
                f"as long, and its path was {report.path_ratio:.2f} times as long."
            )
    elif data.track.plan is None:
        lines.append("The room is unknown, so the coverage is unknown as well.")
    lines.append(_wire_words(data))
    return lines


def _wire_words(data: RunData) -> str:
    frames, lost = sum(count for _, count, _ in data.link), data.lost
    if not frames:
        return "The log contains no messages of the device."
    words = f"The device sent {frames + lost} frames; "
    words += (
        "none was lost" if not lost else f"{lost} were lost ({100 * lost / (frames + lost):.2f} %)"
    )
    bad = data.figure("wire", "crc_errors")
    damaged = data.damaged if bad is None else int(bad)
    return f"{words}, and {damaged or 'none'} arrived damaged."


def _minutes(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.1f} minutes"  # noqa: PLR2004 - two minutes


def tiles(data: RunData) -> list[Tile]:
    """Return the highlighted values of the run."""
    report, made = data.coverage, []
    if report is not None:
        share = report.coverage.mouth_sweepable
        mood = "good" if share >= _GOOD else "fair" if share >= _FAIR else "bad"
        made.append(Tile(f"{100 * share:.1f} %", "of the sweepable floor swept", mood))
        body = f"{100 * report.coverage.body_free:.1f} %"
        made.append(Tile(body, "of the floor under the footprint (the paper's figure)"))
    duration_s, path_m = data.figure("duration_s"), data.figure("path_m")
    if duration_s is not None:
        made.append(Tile(f"{duration_s:.0f} s", "driving"))
    elif data.duration_s:
        made.append(Tile(f"{data.duration_s:.1f} s", "recorded"))
    if path_m is None and data.track.best:
        made.append(Tile(f"{data.track.length_m:.1f} m", "path, from the recorded poses"))
    elif path_m is not None:
        turns = data.figure("turns")
        made.append(Tile(f"{path_m:.1f} m", f"path, {turns:.0f} turns" if turns else "path"))
    if report is not None:
        made.append(Tile(f"{report.largest_hole_cm2:.0f} cm²", "largest unswept piece"))
    energy = data.figure("energy_wh")
    energy, note = (
        (energy, "energy from the battery")
        if energy is not None
        else (
            data.motor_wh,
            "energy into the motors",
        )
    )
    if energy is not None:
        made.append(Tile(f"{energy:.2f} Wh", note))
    collisions = data.figure("collisions")
    if collisions is not None:
        made.append(Tile(f"{collisions:.0f}", "collisions", "good" if not collisions else "bad"))
    if data.link:
        made.append(Tile(str(data.lost), "frames lost", "good" if not data.lost else "fair"))
    return made
