"""Record of changes to an object's attributes."""

from __future__ import annotations

_set = object.__setattr__


class ChangeFlag:
    """Base class that sets the attribute ``changed`` when another attribute is set."""

    __slots__ = ()
    changed: bool

    def __setattr__(self, name: str, value: object) -> None:
        _set(self, name, value)
        if name != "changed":
            _set(self, "changed", True)  # noqa: FBT003 - the new value
