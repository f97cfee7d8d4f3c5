"""Floor plans from a file, or by name: a shipped or generated room, or a layout of the paper."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.files import open_to_read
from bridge.floor_plan.floor_plan import MAX_FILE_BYTES, FloorPlan, FloorPlanError, parse_floorplan
from tools.cli.paths import is_there
from tools.rooms.generator import KINDS, generate_room
from tools.rooms.layouts import LAYOUT, layout_plan

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2

GENERATED = "generated:"
"""Prefix of the names of generated rooms, ``generated:KIND:N``."""
_DRAWN_FROM = 0x5EED
"""First part of the seeds of generated rooms. It makes them differ from other seeds with equal
number."""


def shipped_rooms() -> list[str]:
    """Return the names of the rooms that ship with sweepctl."""
    folder = resources.files("sim_device") / "rooms"
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".json"))


def load_room(room: str, radius_m: float | None = None, start: Pose2 | None = None) -> FloorPlan:
    """Read a room file, or return the room of a name.

    Args:
        room: path of a file, name of a shipped room, ``generated:KIND:N`` or ``layout:NAME``.
        radius_m: radius of a robot that must fit at the start, m; None: no check. The start of a
            generated room depends on it.
        start: start pose that replaces the start of the room.

    Raises:
        FloorPlanError: there is no such room, or its file is invalid.

    """
    if (plan := _made_room(room, radius_m)) is not None:
        if start is None:
            return plan
        return parse_floorplan(
            plan.to_json(), default_name=plan.name, radius_m=radius_m, start=start
        )
    path = Path(room)
    if room in shipped_rooms() and not is_there(path):
        text = (resources.files("sim_device") / "rooms" / f"{room}.json").read_text("utf-8")
        return parse_floorplan(text, default_name=room, radius_m=radius_m, start=start)
    text = _read(room)
    try:
        return parse_floorplan(text, default_name=path.stem, radius_m=radius_m, start=start)
    except FloorPlanError as error:
        raise FloorPlanError(*error.problems, source=f"room {room}") from None
    except (ValueError, OverflowError):  # Python limits the digits of an integer
        raise FloorPlanError(f"room {room}: a number has too many digits") from None


def _read(room: str) -> str:
    """Return the text of a room file."""
    if not room:
        raise _no_room(room)
    try:
        with open_to_read(Path(room), takes_pipe=True) as file:
            content = file.read(MAX_FILE_BYTES + 1)
        if len(content) > MAX_FILE_BYTES:
            raise FloorPlanError(f"room {room}: the file is larger than {MAX_FILE_BYTES} bytes")
        return content.decode()
    except FileNotFoundError:
        raise _no_room(room) from None
    except OSError as error:
        raise FloorPlanError(f"cannot read room {room}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FloorPlanError(f"room {room}: the file is not UTF-8 text") from None
    except ValueError as error:  # the name contains a zero byte
        raise FloorPlanError(f"cannot read room {room!r}: {error}") from None


def _made_room(room: str, radius_m: float | None) -> FloorPlan | None:
    """Return a generated room or a layout; None for another name.

    Raises:
        FloorPlanError: there is no such kind or layout.

    """
    if room.startswith(LAYOUT):
        return layout_plan(room.removeprefix(LAYOUT))
    if not room.startswith(GENERATED):
        return None
    kind, _, number = room.removeprefix(GENERATED).partition(":")
    if kind not in KINDS or not re.fullmatch("[0-9]{1,18}", number):
        raise FloorPlanError(
            f"no room {room!r}: the name must be {GENERATED}KIND:N with a number N of up to 18 "
            f"digits and one of the kinds {', '.join(KINDS)}"
        )
    import numpy as np  # takes time, and a shell's completion of names does not need it

    rng = np.random.default_rng([_DRAWN_FROM, int(number)])
    return generate_room(int(number), rng, kind, radius_m or 0.0)


def _no_room(room: str) -> FloorPlanError:
    return FloorPlanError(
        f"no room {room!r}: give a file or one of {', '.join(shipped_rooms())}, "
        f"{GENERATED}KIND:N, {LAYOUT}NAME"
    )
