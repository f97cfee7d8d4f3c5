"""Driving by hand with a dead man: what moves only while somebody says so. Pure.

Where the terminal tells of releases (the kitty keyboard protocol), a key drives while it is
held; the keyboard's own repeats must go on coming, or it counts as let go: a terminal that
hangs tells of no release. Elsewhere a press drives for 0.7 s at no more than 0.1 m/s, and any
other key stops. A gamepad drives while its dead man button is held and it goes on talking.

The keyboard and the gamepad have threads of their own, and the velocity is read by the loop's:
a lock makes each call whole.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

from bridge.motion.observation import HALT, VelocityCommand

PRESS_S = 0.7
PRESS_M_S = 0.1
PRESS_RAD_S = 0.6
HELD_S = 1.2
"""Without a repeat or another key's event a held key is let go: the slowest usual keyboard
begins to repeat after 0.66 s."""
STICK_S = 0.5
TURN_RAD_S = 1.0
_SPEED_STEP = 1.25
_SLOWEST_M_S = 0.03

DIRECTIONS: dict[str, tuple[float, float]] = {
    "up": (1.0, 0.0),
    "down": (-1.0, 0.0),
    "left": (0.0, 1.0),
    "right": (0.0, -1.0),
    "i": (1.0, 0.0),
    "k": (-1.0, 0.0),
    "j": (0.0, 1.0),
    "l": (0.0, -1.0),
}
"""Key → share of the speed ahead, and of the yaw rate counter-clockwise."""


@dataclass(slots=True)
class DeadMan:
    """Keys and sticks in, the velocity that holds now out. Times are of one clock, seconds."""

    max_speed_m_s: float
    speed_m_s: float
    releases: bool = False
    """The terminal tells of releases."""
    _held: dict[str, float] = field(default_factory=dict)
    """Key → when it was pressed."""
    _event_s: float = -1e9
    _stick: tuple[float, float, float] | None = None
    """Share ahead, share of the yaw rate, and when."""
    _lock: threading.RLock = field(
        default_factory=threading.RLock, init=False, repr=False, compare=False
    )

    def press(self, key: str, time_s: float) -> None:
        """Take a key that went down, or is repeated; one that drives nowhere stops."""
        with self._lock:
            if key not in DIRECTIONS:
                self.let_go()
                return
            if not self.releases:
                self._held.clear()  # the newest press alone counts
            elif key not in self._held and self._opposes(key):
                self._held.clear()
            self._held[key] = time_s
            self._event_s = time_s

    def release(self, key: str, time_s: float) -> None:
        """Take a key that came up."""
        with self._lock:
            self._held.pop(key, None)
            self._event_s = time_s

    def stick(self, ahead: float, turn: float, time_s: float, *, held: bool) -> None:
        """Take a gamepad's sticks, -1..1; ``held``: its dead man button is down."""
        with self._lock:
            self._stick = (_share(ahead), _share(turn), time_s) if held else None

    def let_go(self) -> None:
        """Stop: nothing is held any more."""
        with self._lock:
            self._held.clear()
            self._stick = None

    @property
    def key_m_s(self) -> float:
        """What a key drives at: less than a stick where no release would be told."""
        return self.speed_m_s if self.releases else min(self.speed_m_s, PRESS_M_S)

    def faster(self) -> None:
        """Drive faster, up to the robot's limit."""
        with self._lock:
            self.speed_m_s = min(self.max_speed_m_s, self.speed_m_s * _SPEED_STEP)

    def slower(self) -> None:
        """Drive slower."""
        with self._lock:
            self.speed_m_s = max(_SLOWEST_M_S, self.speed_m_s / _SPEED_STEP)

    def wanted(self, time_s: float) -> VelocityCommand:
        """The velocity that holds now; a halt where nobody says so."""
        with self._lock:
            if self._stick is not None:
                ahead, turn, since_s = self._stick
                if time_s - since_s > STICK_S:
                    self._stick = None
                    return HALT
                return VelocityCommand(ahead * self.speed_m_s, turn * TURN_RAD_S)
            if not self._held:
                return HALT
            limit_s = HELD_S if self.releases else PRESS_S
            if time_s - self._event_s > limit_s:
                self._held.clear()
                return HALT
            ahead = _share(sum(DIRECTIONS[key][0] for key in self._held))
            turn = _share(sum(DIRECTIONS[key][1] for key in self._held))
            if self.releases:
                return VelocityCommand(ahead * self.key_m_s, turn * TURN_RAD_S)
            return VelocityCommand(ahead * self.key_m_s, turn * PRESS_RAD_S)

    def _opposes(self, key: str) -> bool:
        ahead, turn = DIRECTIONS[key]
        return any(
            ahead * DIRECTIONS[k][0] < 0.0 or turn * DIRECTIONS[k][1] < 0.0 for k in self._held
        )


def _share(value: float) -> float:
    if value != value:  # noqa: PLR0124 - not a number
        return 0.0
    return max(-1.0, min(1.0, value))
