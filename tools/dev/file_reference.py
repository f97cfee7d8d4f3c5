"""Generator of the reference pages of robot and room files, from the declarations of the keys.

``python -m tools.dev.file_reference`` writes docs/robot-file.md and the tables of docs/rooms.md; a
test checks that they are current.
"""

from __future__ import annotations

import dataclasses
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bridge.floor_plan.keys import CARPET_KEYS, ROOM_KEYS, THRESHOLD_KEYS
from bridge.motion.robot_model import RangerMount, RobotModel
from bridge.supervise.settings import Level, Rule, SuperviseSettings
from bridge.validation import MAX_TEXT, as_toml
from sim_device.device import parameters
from tools.dev.pages import with_part

if TYPE_CHECKING:
    from collections.abc import Iterable

    from _typeshed import DataclassInstance

    from bridge.floor_plan.keys import RoomKey

_DOCS = Path(__file__).resolve().parents[2] / "docs"
ROBOT_PAGE = _DOCS / "robot-file.md"
ROOM_PAGE = _DOCS / "rooms.md"
_ROOM_TABLES = {"room": ROOM_KEYS, "carpet": CARPET_KEYS, "threshold": THRESHOLD_KEYS}
_HEAD = "| key | unit | range | default | meaning |\n|---|---|---|---|---|"


def robot_page() -> str:
    """Return the whole page docs/robot-file.md."""
    model, rules = RobotModel(), SuperviseSettings()
    sensors = dataclasses.fields(RangerMount)
    own = dataclasses.fields(Rule)
    parts = [
        _INTRODUCTION.format(parameters=_parameters(model)),
        "## The robot\n",
        _table(model, [f for f in dataclasses.fields(model) if f.name not in model.rangers]),
        "\n## Range sensors\n",
        _SENSORS,
        _HEAD,
        *(_sensor_row(model, field) for field in sensors),
        "\n## Supervision\n",
        _RULES,
        _table(rules, [f for f in dataclasses.fields(rules) if f.name not in rules.rules]),
        "\nEach rule has these keys; the rule's own table below gives their defaults:\n",
        _HEAD,
        *(_row(field, "see below") for field in own),
    ]
    for name, rule in rules.rules.items():
        doc = (type(rule).__doc__ or "").splitlines()[0]
        common = ", ".join(f"`{f.name} = {as_toml(getattr(rule, f.name))}`" for f in own)
        parts += [f"\n### supervise.{name}\n", f"{doc} Defaults: {common}.\n"]
        fields = [f for f in dataclasses.fields(rule) if f.name not in {g.name for g in own}]
        if fields:
            parts.append(_table(rule, fields))
    return "\n".join(parts) + "\n"


def _parameters(model: RobotModel) -> str:
    """Return the names of the device's parameters that come from a robot file."""
    names = (
        parameter.name
        for parameter in parameters.table(model, 1)
        if parameter.model_key or parameter.name.rpartition("_")[0] in model.rangers
    )
    text = ", ".join(f"`{name}`" for name in names)
    return textwrap.fill(f"{text}.", 100, initial_indent="  ", subsequent_indent="  ")


def room_page(page: str) -> str:
    """Return docs/rooms.md with new tables."""
    for name, keys in _ROOM_TABLES.items():
        table = "\n".join([_HEAD, *(_room_row(key) for key in keys)])
        page = with_part(page, f"{name} keys", f"\n{table}\n\n")
    return page


def _table(defaults: DataclassInstance, fields: Iterable[dataclasses.Field[Any]]) -> str:
    rows = [_row(field, f"`{as_toml(getattr(defaults, field.name))}`") for field in fields]
    return "\n".join([_HEAD, *rows])


def _sensor_row(model: RobotModel, field: dataclasses.Field[Any]) -> str:
    """Return the row of one key of a range sensor, with the default of each sensor."""
    found = [getattr(mount, field.name) for mount in model.rangers.values()]
    values = [f"`{as_toml(v)}`" if isinstance(v, bool) else f"{v:.4g}" for v in found]
    return _row(field, values[0] if len(set(values)) == 1 else " / ".join(values))


def _row(field: dataclasses.Field[Any], default: str) -> str:
    what = field.metadata
    if "range" in what:
        low, high = what["range"]
        span = f"{low:.7g} to {high:.7g}"
    elif isinstance(field.default, Level):
        span = ", ".join(f"`{level.name.lower()}`" for level in Level)
    elif isinstance(field.default, str):
        span = f"1 to {MAX_TEXT} characters"
    else:
        span = ""
    unit = "" if what.get("unit") == "1" else what.get("unit", "")
    meaning = what.get("meaning") or _REACTIONS[field.name]
    return f"| `{field.name}` | {unit} | {span} | {default} | {meaning} |"


_REACTIONS = {
    "reaction": "what happens after `after_s`",
    "then": "what happens `then_s` later, or at once if the condition is grave",
}
"""Meaning of the keys of a rule that are levels."""


def _room_row(key: RoomKey) -> str:
    if key.is_number:
        begin = f"above {key.low:g}, up" if key.above_low else f"{key.low:g}"
        span = f"{begin} to {key.high:g}"
    else:
        span = key.form
    default = "required" if key.default is None else f"{key.default}"
    unit = "" if key.unit == "1" else key.unit
    return f"| `{key.name}` | {unit} | {span} | {default} | {key.meaning} |"


_INTRODUCTION = """\
# Robot file

<!-- Written by `python -m tools.dev.file_reference`; a test holds it fresh. -->

Every key of a robot file. A robot file tells sweepctl the sizes, limits and sensors of a robot. It
is TOML, and every key has a default: an empty file is the paper's robot. Give it with
`--robot FILE`.

```sh
sweepctl robot new my-robot.toml
sweepctl robot check my-robot.toml
sweepctl robot show my-robot.toml --png my-robot.png
sweepctl simulate case-1 --robot my-robot.toml
```

- `robot new` writes a file with every key and its meaning. `robot check` reports every problem at
  once, with exit status 2. `robot show` prints sizes and draws the robot with its sensors.
- An unknown key is an error; the message names the nearest known key. So is a value outside its
  range, or a robot that cannot work: a sensor far outside the footprint, a wheel base wider than
  the robot.
- A value that is allowed but works badly gives a warning, such as an infrared sensor whose minimum
  range is longer than its distance from a wall at the hull.
- The device stores some of these values as parameters, under the key's name without the unit.
  `sweepctl connect` shows where they differ, and `sweepctl param diff PORT FILE` lists them. The
  parameters:
{parameters}
- Positions are in the robot's frame: x ahead and y to the left of the axle's centre.

![A robot with its sensors, as robot show draws it](robot-show.png)
"""
_SENSORS = """\
Tables `[ultrasonic]`, `[infrared_left]` and `[infrared_right]`. Defaults that differ are
given in this order. A robot has these three: the device reports their ranges in one message, and
a table of another name is an unknown key. A further sensor is a message of a
[plug-in](plugins.md#messages); it is recorded and shown, and rules read it, but no planner does.
"""
_RULES = """\
Tables `[supervise]` and `[supervise.RULE]`. [Supervision](supervise.md) explains the rules.
"""


if __name__ == "__main__":
    ROBOT_PAGE.write_text(robot_page(), encoding="utf-8")
    ROOM_PAGE.write_text(room_page(ROOM_PAGE.read_text(encoding="utf-8")), encoding="utf-8")
