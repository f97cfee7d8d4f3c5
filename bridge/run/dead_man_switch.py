"""Dead-man switch for manual driving: the robot moves only while an input is held. No I/O.

If the terminal reports key releases (kitty keyboard protocol), a key drives while it is held. The
key's repeats must continue, because a terminal that hangs reports no release. In other terminals a
key press drives for 0.7 s at up to 0.1 m/s, and any other key stops the robot. A gamepad drives
while its dead-man button is held and the gamepad sends reports.

The keyboard and the gamepad have their own threads, and the loop's thread reads the velocity. A
lock makes each call atomic.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

from bridge.motion.observation import HALT, VelocityCommand

PRESS_S = 0.7
"""Time for which a key press drives the robot in a terminal without key releases, s."""
PRESS_M_S = 0.1
"""Maximum speed in a terminal without key releases, m/s."""
PRESS_RAD_S = 0.6
"""Yaw rate in a terminal without key releases, rad/s."""
HELD_S = 1.2
"""Time without a key event after which a held key counts as released, s. The slowest usual keyboard
starts to repeat after 0.66 s."""
STICK_S = 0.5
"""Maximum age of a gamepad report, s."""
TURN_RAD_S = 1.0
"""Yaw rate at full deflection, rad/s."""
_SPEED_STEP = 1.25
"""Factor of one speed step."""
_SLOWEST_M_S = 0.03
"""Minimum speed setting, m/s."""

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
"""Map of each key to its share of the forward speed and of the counter-clockwise yaw rate."""


@dataclass(slots=True)
class DeadManSwitch:
    """Converts keys and sticks to the current velocity. All times are in s and from one clock."""

    max_speed_m_s: float
    """Maximum of the speed setting, m/s."""
    speed_m_s: float
    """Speed setting, m/s: forward speed at full deflection."""
    releases: bool = False
    """True if the terminal reports key releases."""
    _held: set[str] = field(default_factory=set)
    """The held keys."""
    _event_s: float = -1e9
    _stick: tuple[float, float, float] | None = None
    """Forward share, yaw-rate share and time (s)."""
    _lock: threading.RLock = field(
        default_factory=threading.RLock, init=False, repr=False, compare=False
    )

    def press(self, key: str, time_s: float) -> None:
        """Handle a key press or repeat; a key without a direction stops."""
        with self._lock:
            if key not in DIRECTIONS:
                self.release_all()
                return
            if not self.releases:
                self._held.clear()  # only the newest press counts
            elif key not in self._held and self._opposes(key):
                self._held.clear()
            self._held.add(key)
            self._event_s = time_s

    def release(self, key: str, time_s: float) -> None:
        """Handle a key release."""
        with self._lock:
            self._held.discard(key)
            self._event_s = time_s

    def stick(self, ahead: float, turn: float, time_s: float, *, held: bool) -> None:
        """Handle a gamepad's sticks, -1..1; ``held``: its dead-man button is pressed."""
        with self._lock:
            self._stick = (_share(ahead), _share(turn), time_s) if held else None

    def release_all(self) -> None:
        """Stop: release all keys and sticks."""
        with self._lock:
            self._held.clear()
            self._stick = None

    @property
    def key_m_s(self) -> float:
        """Speed of a key press, m/s; limited if the terminal reports no releases."""
        return self.speed_m_s if self.releases else min(self.speed_m_s, PRESS_M_S)

    def faster(self) -> None:
        """Increase the speed by one step, up to the robot's limit."""
        with self._lock:
            self.speed_m_s = min(self.max_speed_m_s, self.speed_m_s * _SPEED_STEP)

    def slower(self) -> None:
        """Decrease the speed by one step."""
        with self._lock:
            self.speed_m_s = max(_SLOWEST_M_S, self.speed_m_s / _SPEED_STEP)

    def wanted(self, time_s: float) -> VelocityCommand:
        """Return the velocity at ``time_s``; a halt if nothing is held."""
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
    if value != value:  # noqa: PLR0124 - a comparison with itself finds NaN
        return 0.0
    return max(-1.0, min(1.0, value))
