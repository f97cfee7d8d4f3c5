"""The columns of the library of runs: names, SQL types and meanings, in one table."""

from __future__ import annotations

from typing import NamedTuple


class Column(NamedTuple):
    """One column of the table ``runs``."""

    name: str
    kind: str
    """SQL type: TEXT, REAL or INTEGER."""
    meaning: str
    keys: tuple[str, ...] = ()
    """Path of the value in the summary; empty: the value is in the log's metadata or its file."""


COLUMNS = (
    Column("log", "TEXT", "path of the log"),
    Column("folder", "TEXT", "folder of the log"),
    Column("date", "TEXT", "start of the run in UTC, as 2026-11-25T03:42:01Z"),
    Column("kind", "TEXT", "`live`, `simulated`, `truth` (of an emulator) or `bringup`"),
    Column("robot", "TEXT", "name in the robot file"),
    Column("room", "TEXT", "name of the room", ("room",)),
    Column("planner", "TEXT", "planner; `manual` for a drive by hand", ("planner",)),
    Column("seed", "INTEGER", "seed of a simulated run", ("seed",)),
    Column("noise", "TEXT", "noise level of a simulated run"),
    Column(
        "outcome",
        "TEXT",
        "`complete`, `timeout`, `stopped` or `fault`; null: the log has no end",
        ("outcome",),
    ),
    Column("reason", "TEXT", "why the run ended", ("reason",)),
    Column(
        "coverage",
        "REAL",
        "the main figure: share of the sweepable floor that the mouth swept, 0 to 1",
        ("coverage", "mouth_sweepable"),
    ),
    Column(
        "mouth_passing",
        "REAL",
        "the same of what the mouth reaches in passing",
        ("coverage", "mouth_passing"),
    ),
    Column("mouth_free", "REAL", "mouth over free floor", ("coverage", "mouth_free")),
    Column("body_reachable", "REAL", "body over reachable floor", ("coverage", "body_reachable")),
    Column("body_free", "REAL", "body over free floor", ("coverage", "body_free")),
    Column("eq8", "REAL", "lane lengths times mouth width over free floor", ("coverage", "eq8")),
    Column("duration_s", "REAL", "duration of the drive, s", ("duration_s",)),
    Column("path_m", "REAL", "length of the path, m", ("path_m",)),
    Column("turns", "INTEGER", "number of turns", ("turns",)),
    Column("t90_s", "REAL", "time until 90 % was swept, s", ("t90_s",)),
    Column("t99_s", "REAL", "time until 99 % was swept, s", ("t99_s",)),
    Column("largest_hole_cm2", "REAL", "largest missed piece, cm²", ("largest_hole_cm2",)),
    Column(
        "hole_inradius_m", "REAL", "largest disc in a missed piece, radius, m", ("hole_inradius_m",)
    ),
    Column("repeat_ratio", "REAL", "floor swept again over floor swept", ("repeat_ratio",)),
    Column("collisions", "INTEGER", "number of collisions", ("collisions",)),
    Column("contact_s", "REAL", "time in contact, s", ("contact_s",)),
    Column("energy_wh", "REAL", "energy, Wh", ("energy_wh",)),
    Column("pose_error_m", "REAL", "pose error at the end, m", ("pose_error_m", "end")),
    Column("max_pose_error_m", "REAL", "largest pose error, m", ("pose_error_m", "max")),
    Column("faults", "TEXT", "faults that were requested with `--fault`"),
    Column(
        "device_faults", "INTEGER", "faults that the device reported", ("events", "device_faults")
    ),
    Column("supervision", "INTEGER", "events of the supervision", ("events", "supervise")),
    Column("lost", "INTEGER", "frames lost on the link", ("wire", "lost")),
    Column("crc_errors", "INTEGER", "damaged frames", ("wire", "crc_errors")),
    Column("version", "TEXT", "version of sweepctl that wrote the log"),
    Column("port", "TEXT", "port of the robot"),
    Column("firmware", "TEXT", "name and version of the firmware"),
    Column("uid", "TEXT", "unique number of the device, hexadecimal"),
    Column("bytes", "INTEGER", "size of the log, all its files together, bytes"),
    Column("whole", "INTEGER", "1: complete; 0: the end is missing, or it is still being written"),
    Column("problem", "TEXT", "damage that was found"),
    Column("tags", "TEXT", "tags, with a space before and after each"),
    Column("note", "TEXT", "note"),
)

NAMES = tuple(column.name for column in COLUMNS)
PLACED = ("log", "folder")
"""Columns that depend on the place of the folder, so the index does not store them."""
MARKED = ("tags", "note")
"""Columns that people write."""
INDEXED = tuple(c for c in COLUMNS if c.name not in {*PLACED, *MARKED})
"""Columns that are read from a log."""
