"""What the host watches a robot for, how hard it reacts, and how both are set.

Each rule is a table of the robot file, every key with a default::

    [supervise.stall]
    reaction = "pause"
    current_a = 0.6

    [supervise.fence]
    radius_m = 3.0

``reaction`` is what is done once the rule's condition has held for ``after_s``; where it still
holds ``then_s`` later, or is grave at once, ``then`` is done.
"""

from __future__ import annotations

import dataclasses
import enum
import math
import tomllib
from dataclasses import dataclass, field
from typing import Any

from bridge.errors import ConfigError
from bridge.validation import fill, number

MAX_CORNERS = 256
MAX_SECONDS = 3600.0
Point = tuple[float, float]


class Level(enum.IntEnum):
    """How hard to react; a graver one covers the lesser."""

    OFF = 0
    """The rule is not watched."""
    REPORT = 1
    """An event in the log, and a line for people."""
    SLOW = 2
    """Scaled down for a while."""
    PAUSE = 3
    """Held until somebody says go on."""
    STOP = 4
    """Stopped and latched, cause ``supervise``."""


def _in(default: float, low: float, high: float) -> Any:  # noqa: ANN401 - a dataclass field
    return field(default=default, metadata={"range": (low, high)})


def _seconds(default: float) -> Any:  # noqa: ANN401 - a dataclass field
    return _in(default, 0.0, MAX_SECONDS)


def _polygon(path: str, value: object) -> tuple[Point, ...]:
    if not isinstance(value, list) or not (value == [] or 3 <= len(value) <= MAX_CORNERS):  # noqa: PLR2004 - a triangle
        raise ConfigError(f"{path}: must be a list of 3 to {MAX_CORNERS} corners [x, y]")
    corners = []
    for index, corner in enumerate(value):
        if not isinstance(corner, list) or len(corner) != 2:  # noqa: PLR2004 - x and y
            raise ConfigError(f"{path}[{index}]: must be [x, y], in metres")
        x, y = (number(f"{path}[{index}]", v, -1000.0, 1000.0) for v in corner)
        corners.append((x, y))
    if corners and math.isclose(_area(corners), 0.0, abs_tol=1e-6):
        raise ConfigError(f"{path}: its corners enclose nothing")
    return tuple(corners)


def _area(corners: list[Point]) -> float:
    return 0.5 * sum(
        corners[i - 1][0] * y - x * corners[i - 1][1] for i, (x, y) in enumerate(corners)
    )


@dataclass(frozen=True, slots=True)
class Rule:
    """What every rule has."""

    reaction: Level = Level.STOP
    after_s: float = _seconds(0.0)
    """How long the condition must hold."""
    then: Level = Level.STOP
    then_s: float = _seconds(1.0)
    """After the first reaction, while the condition goes on."""


@dataclass(frozen=True, slots=True)
class StallRule(Rule):
    """A wheel that stands while its motor draws current, or the device says so."""

    reaction: Level = Level.PAUSE
    after_s: float = _seconds(0.6)
    then_s: float = _seconds(1.0)
    current_a: float = _in(0.5, 0.05, 50.0)
    """Above what a wheel draws that turns freely, below its stall current."""


@dataclass(frozen=True, slots=True)
class SlipRule(Rule):
    """The wheels tell another way than gyro and ultrasonic sensor."""

    reaction: Level = Level.SLOW
    after_s: float = _seconds(0.3)
    then: Level = Level.PAUSE
    then_s: float = _seconds(3.0)
    difference_m_s: float = _in(0.015, 0.001, 1.0)
    """Between the wheels' rims, by encoders and by gyro."""
    share: float = _in(0.25, 0.02, 1.0)
    """Of the way by the wheels by which the range ahead does not close."""


@dataclass(frozen=True, slots=True)
class TiltRule(Rule):
    """The body leans."""

    after_s: float = _seconds(0.3)
    angle_deg: float = _in(12.0, 1.0, 90.0)


@dataclass(frozen=True, slots=True)
class LiftedRule(Rule):
    """Somebody has taken it up, or it hangs over an edge."""


@dataclass(frozen=True, slots=True)
class BumpRule(Rule):
    """It bumps too often, or a bumper stays pressed."""

    reaction: Level = Level.REPORT
    then: Level = Level.PAUSE
    then_s: float = _seconds(10.0)
    count: float = _in(18.0, 1.0, 10_000.0)
    window_s: float = _seconds(15.0)
    held_s: float = _seconds(5.0)


@dataclass(frozen=True, slots=True)
class CliffRule(Rule):
    """No floor ahead; grave where it goes on all the same."""

    reaction: Level = Level.REPORT
    then_s: float = _seconds(3.0)
    ahead_m: float = _in(0.05, 0.0, 1.0)
    """Way ahead with the cliff in sight after which it is grave."""


@dataclass(frozen=True, slots=True)
class BatteryRule(Rule):
    """The battery is low; grave where it is empty."""

    reaction: Level = Level.REPORT
    after_s: float = _seconds(0.5)
    then_s: float = _seconds(MAX_SECONDS)
    low_v: float = _in(12.8, 1.0, 100.0)
    empty_v: float = _in(12.0, 1.0, 100.0)


@dataclass(frozen=True, slots=True)
class SilenceRule(Rule):
    """Nothing is heard of the device, or one of its streams has ended."""

    reaction: Level = Level.REPORT
    then_s: float = _seconds(0.3)
    silent_s: float = _in(0.4, 0.05, MAX_SECONDS)
    stream_s: float = _in(1.0, 0.1, MAX_SECONDS)


@dataclass(frozen=True, slots=True)
class ProgressRule(Rule):
    """It works and gets nowhere."""

    reaction: Level = Level.PAUSE
    then_s: float = _seconds(60.0)
    window_s: float = _in(60.0, 1.0, MAX_SECONDS)
    min_side_m: float = _in(0.10, 0.001, 10.0)
    """It must leave a square of this side once in the window."""


@dataclass(frozen=True, slots=True)
class FenceRule(Rule):
    """It is outside of where it may be; grave at once. Without a fence nothing is outside."""

    radius_m: float = _in(0.0, 0.0, 1000.0)
    """Around where it was as the watch began; 0: none."""
    polygon: tuple[Point, ...] = field(default=(), metadata={"read": _polygon})
    """Corners, in the frame of the map."""


@dataclass(frozen=True, slots=True)
class DisagreementRule(Rule):
    """The device's planner says what a shadow of it does not find."""

    reaction: Level = Level.PAUSE
    then_s: float = _seconds(5.0)
    distance_m: float = _in(0.03, 0.001, 1.0)
    """Between D and the odometry of the lane."""
    equal_m: float = _in(0.02, 0.0, 1.0)
    """Up to which the device takes D for equal to Prev-D."""
    motion_s: float = _in(1.0, 0.1, 60.0)
    """How long it may move otherwise than it says."""


@dataclass(frozen=True, slots=True)
class SensorRule(Rule):
    """The device says that a sensor is broken, or one gives the same for ever."""

    reaction: Level = Level.PAUSE
    then: Level = Level.PAUSE


@dataclass(frozen=True, slots=True)
class ResetRule(Rule):
    """The device has booted anew."""


@dataclass(frozen=True, slots=True)
class SuperviseSettings:
    """Every rule, and what pauses and slow driving come to."""

    stall: StallRule = StallRule()
    slip: SlipRule = SlipRule()
    tilt: TiltRule = TiltRule()
    lifted: LiftedRule = LiftedRule()
    bump: BumpRule = BumpRule()
    cliff: CliffRule = CliffRule()
    battery: BatteryRule = BatteryRule()
    silence: SilenceRule = SilenceRule()
    progress: ProgressRule = ProgressRule()
    fence: FenceRule = FenceRule()
    disagreement: DisagreementRule = DisagreementRule()
    sensor: SensorRule = SensorRule()
    reset: ResetRule = ResetRule()
    slow_factor: float = _in(0.5, 0.05, 1.0)
    """What speeds are scaled by."""
    slow_for_s: float = _in(5.0, 0.1, MAX_SECONDS)
    """How long, after the last cause for it."""
    pause_limit_s: float = _in(60.0, 1.0, MAX_SECONDS)
    """A pause that nobody ends becomes a stop."""

    @property
    def rules(self) -> dict[str, Rule]:
        """Every rule by its name."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, Rule)}


PREFIX = "supervise"


def settings_from(table: object, base: SuperviseSettings | None = None) -> SuperviseSettings:
    """Read the table ``[supervise]`` of a robot file over ``base``, the defaults.

    Raises:
        ConfigError: an unknown key, or a value that cannot be; the text names the key.

    """
    if not isinstance(table, dict):
        raise ConfigError(f"{PREFIX}: must be a table")
    problems: list[str] = []
    settings = fill(base or SuperviseSettings(), table, f"{PREFIX}.", problems)
    if problems:
        raise ConfigError(*problems)
    return settings


def parse_rule(settings: SuperviseSettings, text: str) -> SuperviseSettings:
    """One setting as text, ``stall.reaction=pause`` or ``pause_limit_s=20``, over others.

    Raises:
        ConfigError: it names no key, or a value that cannot be.

    """
    path, equals, value = text.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        raise ConfigError(f"{text[:80]!r}: write RULE.KEY=VALUE, such as stall.reaction=pause")
    try:
        parsed: Any = tomllib.loads(f"value = {value.strip()}")["value"]
    except (ValueError, RecursionError):
        parsed = value.strip()  # a bare word, such as pause
    for key in reversed(keys):
        parsed = {key: parsed}
    return settings_from(parsed, settings)


def to_toml(settings: SuperviseSettings) -> str:
    """The settings as tables of a robot file, which :func:`settings_from` reads back."""
    lines = [f"[{PREFIX}]"]
    for each in dataclasses.fields(settings):
        value = getattr(settings, each.name)
        if not isinstance(value, Rule):
            lines.append(f"{each.name} = {value!r}")
    for name, rule in settings.rules.items():
        lines.append(f"\n[{PREFIX}.{name}]")
        lines += [
            f"{each.name} = {_as_toml(getattr(rule, each.name))}"
            for each in dataclasses.fields(rule)
        ]
    return "\n".join(lines) + "\n"


def _as_toml(value: object) -> str:
    if isinstance(value, Level):
        return f'"{value.name.lower()}"'
    if isinstance(value, tuple):
        return f"[{', '.join(f'[{x!r}, {y!r}]' for x, y in value)}]"
    return repr(value)
