"""Messages of plug-ins: entry points of the group ``sweepctl.messages``, each a message class.

They join the catalogue, so codec, generated code, log schemas and tables have them too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import sweepctl_plugins
from protocol.schema.lint import findings
from protocol.schema.message import MAKERS_TYPES, Direction, Message, specify

if TYPE_CHECKING:
    from collections.abc import Iterable

    from protocol.schema.message import MessageSpec
    from sweepctl_plugins import Plugin


def plugged_messages(own: Iterable[type[Message]]) -> tuple[type[Message], ...]:
    """Return the messages of installed plug-ins that can join ``own``.

    An invalid message is disabled with a warning that names its package. If two packages claim the
    same type or name, both messages are rejected, because a device could mean either.
    """
    taken = {specify(message).name for message in own}
    sound: list[tuple[Plugin, MessageSpec]] = []
    for plugin, message in sweepctl_plugins.usable("messages"):
        try:
            spec = specify(message)
        except (AttributeError, TypeError) as error:
            sweepctl_plugins.disable(f"{plugin} is no message: {error}")
            continue
        wrong = _wrong(spec, taken)
        if wrong:
            sweepctl_plugins.disable(f"{plugin}: {'; '.join(wrong)}")
        else:
            sound.append((plugin, spec))
    return tuple(spec.cls for _, spec in sound if not _clashes(spec, sound))


def _wrong(spec: MessageSpec, taken: set[str]) -> list[str]:
    """Return why a message cannot join the catalogue."""
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
    if spec.name in taken:
        found.append(f"the name {spec.name!r} is taken")
    return found


def _types(spec: MessageSpec) -> list[int]:
    """Return the types that a message claims: its own, and those of its parts on CAN."""
    return sorted({spec.type_id, *(part.can_type for part in spec.can_parts)})


def _clashes(spec: MessageSpec, sound: list[tuple[Plugin, MessageSpec]]) -> bool:
    """Return whether another plug-in claims a type or the name too, and report it."""
    claims = [(f"type {t:#x}", [str(p) for p, s in sound if t in _types(s)]) for t in _types(spec)]
    claims.append((f"name {spec.name!r}", [str(p) for p, s in sound if s.name == spec.name]))
    for what, plugins in claims:
        if len(plugins) > 1:
            sweepctl_plugins.disable(
                f"{what} is claimed by {' and by '.join(sorted(plugins))}; uninstall all but one"
            )
            return True
    return False
