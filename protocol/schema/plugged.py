"""Messages of plug-ins.

Each entry point of the group ``sweepctl.messages`` is a message class. These messages are added to
the catalogue, so the codec, generated code, log schemas and tables also contain them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import sweepctl_plugins
from protocol.schema.lint import findings
from protocol.schema.message import MAKERS_TYPES, Direction, Message, specify

if TYPE_CHECKING:
    from collections.abc import Iterable
    from enum import IntEnum

    from protocol.schema.message import MessageSpec
    from sweepctl_plugins import Plugin


def plugged_messages(own: Iterable[type[Message]]) -> tuple[type[Message], ...]:
    """Return the valid messages of installed plug-ins; ``own`` are the project's messages.

    An invalid message is omitted with a warning that names its package. If two packages use the
    same type or name, both messages are omitted, because a received frame would be ambiguous.
    """
    ours = [specify(message) for message in own]
    sound: list[tuple[Plugin, MessageSpec]] = []
    for plugin, message in sweepctl_plugins.usable("messages"):
        try:
            spec = specify(message)
        except (AttributeError, TypeError) as error:
            sweepctl_plugins.disable(f"{plugin} is no message: {error}")
            continue
        wrong = _wrong(spec, ours)
        if wrong:
            sweepctl_plugins.disable(f"{plugin}: {'; '.join(wrong)}")
        else:
            sound.append((plugin, spec))
    return tuple(spec.cls for _, spec in sound if not _clashes(spec, sound))


def _wrong(spec: MessageSpec, ours: list[MessageSpec]) -> list[str]:
    """Return the reasons why a message cannot be added to the project's messages."""
    found = findings([spec])
    low, high = MAKERS_TYPES[0], MAKERS_TYPES[-1]
    found += [
        f"type {claimed:#x} is not from {low:#x} to {high:#x}"
        for claimed in _types(spec)
        if claimed not in MAKERS_TYPES
    ]
    if spec.direction is not Direction.DEVICE:
        found.append("a plug-in may add messages of devices only, none that the host sends")
    if spec.bootstrap or spec.to_all:
        found.append("it may be neither bootstrap nor to_all")
    if spec.name in {own.name for own in ours}:
        found.append(f"the name {spec.name!r} is taken")
    taken = _enums(ours)
    found += [
        f"the enumeration name {name!r} is taken"
        for name, enum in _enums([spec]).items()
        if taken.get(name, enum) is not enum
    ]
    return found


def _enums(specs: Iterable[MessageSpec]) -> dict[str, type[IntEnum]]:
    """Return the enumerations that messages use, by name."""
    return {f.enum.__name__: f.enum for s in specs for f in s.fields if f.enum is not None}


def _types(spec: MessageSpec) -> list[int]:
    """Return the types that a message uses: its own type, and the types of its CAN parts."""
    return sorted({spec.type_id, *(part.can_type for part in spec.can_parts)})


def _clashes(spec: MessageSpec, sound: list[tuple[Plugin, MessageSpec]]) -> bool:
    """Return whether another plug-in claims the same type or name, and report the conflict."""
    claims = [(f"type {t:#x}", [str(p) for p, s in sound if t in _types(s)]) for t in _types(spec)]
    claims.append((f"name {spec.name!r}", [str(p) for p, s in sound if s.name == spec.name]))
    for name, enum in _enums([spec]).items():
        users = [str(p) for p, s in sound if s is spec or _enums([s]).get(name, enum) is not enum]
        claims.append((f"enumeration name {name!r}", users))
    for what, plugins in claims:
        if len(plugins) > 1:
            sweepctl_plugins.disable(
                f"{what} is claimed by {' and by '.join(sorted(plugins))}; uninstall all but one"
            )
            return True
    return False
