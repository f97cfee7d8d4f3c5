"""Floor plans from a file, or by the name of a room that ships with sweepctl."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.files import open_to_read
from bridge.floor_plan.floor_plan import MAX_FILE_BYTES, FloorPlan, FloorPlanError, parse_floorplan
from tools.cli.paths import is_there

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2


def shipped_rooms() -> list[str]:
    """Return the names of the rooms that ship with sweepctl."""
    folder = resources.files("sim_device") / "rooms"
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".json"))


def load_room(room: str, radius_m: float | None = None, start: Pose2 | None = None) -> FloorPlan:
    """Read a room file, or a room that ships with sweepctl.

    Args:
        room: path of a file, or name of a room.
        radius_m: radius of a robot that must fit at the start, m; None: no check.
        start: start pose that replaces the start of the room.

    Raises:
        FloorPlanError: there is no such room, or its file is invalid.

    """
    if not room:
        raise _no_room(room)
    path = Path(room)
    if room in shipped_rooms() and not is_there(path):
        text = (resources.files("sim_device") / "rooms" / f"{room}.json").read_text("utf-8")
        return parse_floorplan(text, default_name=room, radius_m=radius_m, start=start)
    try:
        with open_to_read(path, takes_pipe=True) as file:
            content = file.read(MAX_FILE_BYTES + 1)
        if len(content) > MAX_FILE_BYTES:
            raise FloorPlanError(f"room {room}: the file is larger than {MAX_FILE_BYTES} bytes")
        text = content.decode()
    except FileNotFoundError:
        raise _no_room(room) from None
    except OSError as error:
        raise FloorPlanError(f"cannot read room {room}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FloorPlanError(f"room {room}: the file is not UTF-8 text") from None
    except ValueError as error:  # the name contains a zero byte
        raise FloorPlanError(f"cannot read room {room!r}: {error}") from None
    try:
        return parse_floorplan(text, default_name=path.stem, radius_m=radius_m, start=start)
    except FloorPlanError as error:
        raise FloorPlanError(*error.problems, source=f"room {room}") from None
    except (ValueError, OverflowError):  # Python limits the digits of an integer
        raise FloorPlanError(f"room {room}: a number has too many digits") from None


def _no_room(room: str) -> FloorPlanError:
    return FloorPlanError(f"no room {room!r}: give a file or one of {', '.join(shipped_rooms())}")
