"""What a caller can do about an error, as a code: each interface has words of its own for it."""

from __future__ import annotations

from enum import Enum


class Remedy(Enum):
    """What would let the refused thing be done; the value is how a program says it."""

    CLEAR_STOP = ", then call enable(clear_stop=True)"
    """A stop is latched for safety; a person who looked may clear it."""
    KEY = ": give it as bridge.open(port, key=...)"
    """The robot has a key, and the session does not sign with it."""
    NODE = "; choose one with bridge.open(port, node=N)"
    """Several devices answer."""
    FORCE = ", or force=True to replace it"
    """The file exists."""
