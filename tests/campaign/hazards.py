"""Hazards for a moving robot, and the supervision rules that must detect them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

ROOMS = (
    *("case-1", "case-2", "columns", "comprehensive", "empty", "l-room", "studio-flat"),
    *("table-and-chair", "two-rooms"),
)
ONBOARD = ("paper", "recovery", "u-shape", "random")
HOST = ("recovery", "paper")
GRACE_S = 2.0
STAIRS = "stairs"


@dataclass(frozen=True)
class Hazard:
    """One kind of hazard and the rules that must detect it."""

    name: str
    rules: frozenset[str]
    faults: tuple[str, ...] = ()
    """Faults, with ``{t}`` in place of the time."""
    lasts_s: float = 10.0
    lie: str = ""
    settings: dict[str, object] = field(default_factory=dict)
    rooms: tuple[str, ...] = ROOMS
    planners: tuple[str, ...] = ONBOARD
    onboard: bool = True

    @property
    def there(self) -> bool:
        """Return whether the hazard exists from the beginning, as a room or a rule's setting."""
        return bool(self.settings) or STAIRS in self.rooms

    def ends_s(self, at_s: float) -> float:
        """Return the end of a hazard that began at ``at_s``.

        A stairwell, a fence and false reports never end.
        """
        return math.inf if self.there or self.lie else at_s + self.lasts_s


def _hazard(name: str, rules: str, lasts_s: float, *faults: str, **more: object) -> Hazard:
    return Hazard(name, frozenset(rules.split()), faults, lasts_s, **more)  # type: ignore[arg-type]  # fields


LANES = ("paper",)
IN_LANES = ("paper", "u-shape")
SHORT = ("studio-flat",)
"""Rooms that lane planners finish in half a minute, before a hazard can begin and be detected."""
OPEN = ("case-1", "case-2", "empty")
"""Rooms with few obstacles, where one long lane follows another."""
HAZARDS: tuple[Hazard, ...] = (
    _hazard("wheel stuck, one", "stall", 4, "wheel-stuck@{t}:4:side=left"),
    _hazard("wheel stuck, both", "stall", 4, "wheel-stuck@{t}:4:side=both"),
    _hazard("one wheel slips by 30 %", "slip", 10, "wheel-slip@{t}:10:side=right,share=0.3"),
    _hazard("both wheels slip by 40 %", "slip", 40, "wheel-slip@{t}:40:side=both,share=0.4"),
    _hazard("both wheels spin", "slip", 40, "wheel-slip@{t}:40:side=both,share=1"),
    _hazard(
        "encoder misses 40 %",
        "slip disagreement sensor",
        15,
        "encoder-dropout@{t}:15:side=left,share=0.4",
    ),
    _hazard("encoder dead", "slip sensor", 10, "encoder-dropout@{t}:10:side=right,share=1"),
    _hazard("gyro off by 6 °/s", "slip", 20, "imu-biased@{t}:20:gyro=6"),
    _hazard("inertial sensor frozen", "sensor slip", 10, "imu-frozen@{t}:10"),
    _hazard("leans by 17°", "tilt", 5, "imu-biased@{t}:5:gyro=0,accel=0.3"),
    _hazard("lifted", "lifted", 3, "lifted@{t}:3"),
    _hazard("bumper stuck", "bump", 20, "bumper-stuck@{t}:20:side=right"),
    _hazard(
        "bumps without end",
        "bump",
        30,
        *(f"bumper-stuck@{{t}}+{0.6 * i:.1f}:0.2" for i in range(50)),
    ),
    _hazard("ultrasonic constant", "slip sensor", 40, "ultrasonic-constant@{t}:40:m=1.2"),
    _hazard(
        "ultrasonic blind", "sensor", 150, "ultrasonic-blind@{t}:150", rooms=("case-1", "case-2")
    ),
    _hazard("battery flat", "battery", 5, "battery-flat@{t}:charge=0.02"),
    _hazard("line silent", "silence", 1, "silence@{t}:1"),
    _hazard("unplugged", "silence", 2, "unplug@{t}:2"),
    _hazard("wrong baud rate", "silence", 2, "wrong-baud@{t}:2"),
    _hazard("firmware hangs", "reset silence", 3, "hang@{t}"),
    _hazard("reset", "reset silence", 3, "reset@{t}:cause=pin"),
    _hazard("brown-out", "reset silence", 3, "brown-out@{t}:off=0.4"),
    _hazard(
        "enclosed",
        "progress",
        120,
        "ultrasonic-constant@{t}:120:m=0.03",
        planners=("random",),
        rooms=OPEN,
    ),
    _hazard("no floor ahead", "cliff", 60, rooms=(STAIRS,), planners=("u-shape", "paper")),
    _hazard(
        "leaves its fence",
        "fence",
        90,
        settings={"fence": {"radius_m": 0.5}},
        planners=("paper", "u-shape"),
    ),
    _hazard(
        "reports D 5 cm too long",
        "disagreement",
        60,
        lie="distance",
        planners=LANES,
        rooms=OPEN,
    ),
    _hazard(
        "reports another case",
        "disagreement",
        60,
        lie="case",
        planners=LANES,
        rooms=OPEN,
    ),
    _hazard(
        "reports another Length",
        "disagreement",
        150,
        lie="length",
        planners=LANES,
        rooms=("case-1",),
    ),
    _hazard(
        "reports another Prev-D",
        "disagreement",
        60,
        lie="previous",
        planners=LANES,
        rooms=OPEN,
    ),
    _hazard(
        "T jumps by two",
        "disagreement",
        60,
        lie="turns",
        planners=LANES,
        rooms=OPEN,
    ),
    _hazard("reports paused, and drives", "disagreement", 20, lie="paused"),
    _hazard("reports a turn, and drives", "disagreement", 30, lie="turn"),
    _hazard(
        "host plans: wheel stuck",
        "stall",
        4,
        "wheel-stuck@{t}:4:side=left",
        onboard=False,
        planners=HOST,
    ),
    _hazard(
        "host plans: one wheel slips",
        "slip",
        10,
        "wheel-slip@{t}:10:side=left,share=0.3",
        onboard=False,
        planners=HOST,
    ),
    _hazard(
        "host plans: leans",
        "tilt",
        5,
        "imu-biased@{t}:5:gyro=0,accel=0.3",
        onboard=False,
        planners=HOST,
    ),
    _hazard("host plans: lifted", "lifted", 3, "lifted@{t}:3", onboard=False, planners=HOST),
)
