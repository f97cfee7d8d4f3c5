"""Parameters and modes of the reference firmware, from the tables of the Python device.

    python -m tools.dev.firmware_tables

writes ``parameter_table.h`` and ``mode_table.h``, from which the C core makes its own tables.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bridge.motion.robot_model import RobotModel
from protocol.messages.values import NackReason, ParameterKind
from sim_device.device import modes, parameters
from tools.cli.console import write_line

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from sim_device.device.parameters import TableParameter

FOLDER = Path(__file__).resolve().parents[2] / "sim_device" / "firmware" / "core"
COMMAND = "python -m tools.dev.firmware_tables"
_UNITS = {"m": "M", "m/s": "M_S", "rad/s": "RAD_S", "m/s2": "M_S2", "V": "V"}
"""Suffix of a constant by the unit of its parameter; other units have no suffix."""
_ASLEEP = (modes.DeviceState.OFF, modes.DeviceState.BOOT)
"""States in which no program runs, so the firmware does not have them."""
_WAKING = (
    modes.Event.SUPPLY_LOST,
    modes.Event.SUPPLY_BACK,
    modes.Event.RESET,
    modes.Event.BOOTED,
)
"""Events that no program handles."""


def render() -> dict[str, str]:
    """Return the text of each file by its name."""
    return {"parameter_table.h": _parameters(), "mode_table.h": _modes()}


def _file(name: str, source: str, body: Iterable[str]) -> str:
    guard = name.upper().replace(".", "_")
    return "\n".join(
        [
            f"/* Made by `{COMMAND}` from {source}: change that. */",
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            *body,
            "",
            "#endif",
            "",
        ]
    )


def _macro(head: str, rows: Iterable[str]) -> list[str]:
    """Return a macro of several lines."""
    lines = [f"#define {head}", *(f"    {row}" for row in rows)]
    return [*(f"{line} \\" for line in lines[:-1]), lines[-1]]


# ---- parameters ---------------------------------------------------------------------------


def constant(parameter: TableParameter) -> str:
    """Return the name of a parameter's factory value in C."""
    name = parameter.name.removeprefix("robot_").upper()
    suffix = _UNITS.get(parameter.unit, "")
    return f"ROBOT_{name}_{suffix}" if suffix else f"ROBOT_{name}"


def _parameters() -> str:
    rows = parameters.table(RobotModel(), node=1)
    return _file("parameter_table.h", "sim_device/device/parameters.py", _parameter_lines(rows))


def _parameter_lines(rows: Iterable[TableParameter]) -> Iterator[str]:
    rows = list(rows)
    yield "/* Factory values. Your ROBOT_CONFIG (robot.h) may define others before. */"
    for row in rows:
        if not row.read_only:
            yield f"#ifndef {constant(row)}"
            yield f"#define {constant(row)} {_float(row.default)} /* {row.doc} */"
            yield "#endif"
    yield ""
    yield "/* Every parameter by its number: X(NAME, label, factory, low, high, kind, flags). */"
    yield from _macro("PARAMETER_TABLE(X)", map(_parameter, rows))


def _parameter(row: TableParameter) -> str:
    factory = _float(row.default) if row.read_only else constant(row)
    kind = "F32" if row.kind is ParameterKind.F32 else "U32"
    flags = [
        name
        for name, present in (("READ_ONLY", row.read_only), ("REBOOT", row.needs_reboot))
        if present
    ]
    return (
        f'X({row.name.upper()}, "{row.label}", {factory}, {_float(row.low)}, {_float(row.high)}, '
        f"{kind}, {' | '.join(flags) or '0'})"
    )


def _float(value: float) -> str:
    return f"{float(value)!r}f"


# ---- modes --------------------------------------------------------------------------------


def _modes() -> str:
    return _file("mode_table.h", "sim_device/device/modes.py", _mode_lines())


def _mode_lines() -> Iterator[str]:
    states = [state for state in modes.DeviceState if state not in _ASLEEP]
    events = [event for event in modes.Event if event not in _WAKING]
    yield "/* X(STATE, mode that the status message reports in it). */"
    yield from _macro("MODE_STATES(X)", (f"X({s.name}, {modes.MODE_OF[s].name})" for s in states))
    yield ""
    yield from _macro("MODE_EVENTS(X)", (f"X({event.name})" for event in events))
    yield ""
    yield "/* X(CONDITION, bit). */"
    guards = enumerate(modes.Guard)
    yield from _macro("MODE_GUARDS(X)", (f"X({g.name}, {1 << i}u)" for i, g in guards))
    yield ""
    yield "/* For a state and event, the first row applies that has no condition or a true one:"
    yield " * ENTERS(states, EVENT, condition, STATE), REJECTS(states, EVENT, condition, REASON)."
    yield " * States are IN(STATE), ALL, or FREE: all but STOPPED. */"
    yield from _macro("MODE_ROWS(ENTERS, REJECTS)", _mode_rows(states, events))


def _mode_rows(states: list[modes.DeviceState], events: list[modes.Event]) -> Iterator[str]:
    for event in events:
        alike: dict[modes.Branches, list[modes.DeviceState]] = {}
        for state in states:
            branches = modes.TABLE[state, event]
            if branches is not modes.NOTHING:
                alike.setdefault(branches, []).append(state)
        for branches, found in alike.items():
            mask = _mask(found, states)
            for outcome, guard in branches:
                condition = "0" if guard is None else f"GUARD_{guard.name}"
                if outcome is not None:
                    kind = "REJECTS" if isinstance(outcome, NackReason) else "ENTERS"
                    yield f"{kind}({mask}, {event.name}, {condition}, {outcome.name})"


def _mask(found: list[modes.DeviceState], states: list[modes.DeviceState]) -> str:
    if found == states:
        return "ALL"
    if found == [state for state in states if state is not modes.DeviceState.STOPPED]:
        return "FREE"
    return " | ".join(f"IN({state.name})" for state in found)


def main() -> None:
    """Write the files."""
    for name, text in render().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
        write_line(f"wrote {FOLDER / name}")


if __name__ == "__main__":
    main()
