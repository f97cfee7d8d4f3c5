"""Settings of the supervision: rules, limits and reactions.

Each rule is a table of the robot file; every key has a default::

    [supervise.stall]
    reaction = "pause"
    current_a = 0.6

    [supervise.fence]
    radius_m = 3.0

The supervisor reacts with ``reaction`` if the rule's condition has held for ``after_s``. It reacts
with ``then`` if the condition still holds ``then_s`` later, or at once if the condition is grave.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import math
import tomllib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import sweepctl_plugins
from bridge.errors import ConfigError
from bridge.motion.robot_model import bounded
from bridge.validation import fill, number

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel

MAX_CORNERS = 256
"""Maximum number of corners of a fence."""
MAX_SECONDS = 3600.0
"""Maximum of most settings that are times, s."""
Point = tuple[float, float]


class Level(enum.IntEnum):
    """Severity of a reaction; a higher level includes the lower levels."""

    OFF = 0
    """The rule is off."""
    REPORT = 1
    """An event in the log and a line on the terminal."""
    SLOW = 2
    """Speeds are reduced for some time."""
    PAUSE = 3
    """The robot stops until the operator resumes the run."""
    STOP = 4
    """A stop is latched, cause ``supervise``."""


def _after(default: float) -> Any:  # noqa: ANN401 - the type of a dataclass field
    meaning = "time for which the condition must hold before `reaction`"
    return bounded(default, 0.0, MAX_SECONDS, "s", meaning)


def _then(default: float) -> Any:  # noqa: ANN401 - the type of a dataclass field
    meaning = "time from the first reaction to `then` while the condition holds"
    return bounded(default, 0.0, MAX_SECONDS, "s", meaning)


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
        raise ConfigError(f"{path}: the corners enclose no area")
    return tuple(corners)


def _area(corners: list[Point]) -> float:
    return 0.5 * sum(
        corners[i - 1][0] * y - x * corners[i - 1][1] for i, (x, y) in enumerate(corners)
    )


@dataclass(frozen=True, slots=True)
class Rule:
    """Settings that every rule has."""

    reaction: Level = Level.STOP
    after_s: float = _after(0.0)
    then: Level = Level.STOP
    then_s: float = _then(1.0)


@dataclass(frozen=True, slots=True)
class StallRule(Rule):
    """A wheel stands still while its motor draws current, or the device reports a stall."""

    reaction: Level = Level.PAUSE
    after_s: float = _after(0.6)
    then_s: float = _then(1.0)
    current_a: float = bounded(
        0.5,
        0.05,
        50.0,
        "A",
        "motor current: above that of a free-running wheel, below the stall current",
    )


@dataclass(frozen=True, slots=True)
class SlipRule(Rule):
    """The motion by the wheels differs from that by gyro or ultrasonic sensor."""

    reaction: Level = Level.SLOW
    after_s: float = _after(0.3)
    then: Level = Level.PAUSE
    then_s: float = _then(3.0)
    difference_m_s: float = bounded(
        0.015, 0.001, 1.0, "m/s", "speed difference between the wheels' rims and the gyro's turn"
    )
    share: float = bounded(
        0.25,
        0.02,
        1.0,
        "1",
        "share of the wheels' distance by which the range ahead does not decrease",
    )


@dataclass(frozen=True, slots=True)
class TiltRule(Rule):
    """The robot tilts."""

    after_s: float = _after(0.3)
    angle_deg: float = bounded(12.0, 1.0, 90.0, "°", "angle between gravity and the upright axis")


@dataclass(frozen=True, slots=True)
class LiftedRule(Rule):
    """The robot was lifted, or hangs over an edge."""


@dataclass(frozen=True, slots=True)
class BumpRule(Rule):
    """The robot bumps too often, or a bumper switch stays pressed."""

    reaction: Level = Level.REPORT
    then: Level = Level.PAUSE
    then_s: float = _then(10.0)
    count: float = bounded(18.0, 1.0, 10_000.0, "1", "number of bumps within `window_s`")
    window_s: float = bounded(15.0, 0.0, MAX_SECONDS, "s", "time in which bumps are counted")
    held_s: float = bounded(5.0, 0.0, MAX_SECONDS, "s", "time for which a switch is closed")


@dataclass(frozen=True, slots=True)
class CliffRule(Rule):
    """The cliff sensor finds no floor; grave if the robot drives on."""

    reaction: Level = Level.REPORT
    then_s: float = _then(3.0)
    ahead_m: float = bounded(
        0.05, 0.0, 1.0, "m", "distance driven ahead after the detection that is grave"
    )


@dataclass(frozen=True, slots=True)
class BatteryRule(Rule):
    """The battery is low; grave if it is empty."""

    reaction: Level = Level.REPORT
    after_s: float = _after(0.5)
    then_s: float = _then(MAX_SECONDS)
    low_v: float = bounded(12.8, 1.0, 100.0, "V", "low voltage")
    empty_v: float = bounded(12.0, 1.0, 100.0, "V", "empty voltage, which is grave")


@dataclass(frozen=True, slots=True)
class SilenceRule(Rule):
    """The device is silent, or one of its streams has stopped."""

    reaction: Level = Level.REPORT
    then_s: float = _then(0.3)
    silent_s: float = bounded(0.4, 0.05, MAX_SECONDS, "s", "time without a frame")
    stream_s: float = bounded(1.0, 0.1, MAX_SECONDS, "s", "time without a message of a stream")


@dataclass(frozen=True, slots=True)
class ProgressRule(Rule):
    """The robot drives but stays in one place."""

    reaction: Level = Level.PAUSE
    then_s: float = _then(60.0)
    window_s: float = bounded(
        60.0, 1.0, MAX_SECONDS, "s", "time in which the robot must leave the square"
    )
    min_side_m: float = bounded(
        0.10, 0.001, 10.0, "m", "side of a square that the robot must leave within the window"
    )


@dataclass(frozen=True, slots=True)
class FenceRule(Rule):
    """The robot is outside its fence. The default has no fence."""

    radius_m: float = bounded(
        0.0, 0.0, 1000.0, "m", "radius around the pose at the start of the run; 0: none"
    )
    polygon: tuple[Point, ...] = field(
        default=(),
        metadata={
            "read": _polygon,
            "unit": "m",
            "meaning": f"3 to {MAX_CORNERS} corners `[x, y]` in the map frame",
        },
    )


@dataclass(frozen=True, slots=True)
class DisagreementRule(Rule):
    """The device's planner reports values that contradict the measured ones."""

    reaction: Level = Level.PAUSE
    then_s: float = _then(5.0)
    distance_m: float = bounded(
        0.03, 0.001, 1.0, "m", "maximum difference of D and the odometry of the lane"
    )
    equal_m: float = bounded(
        0.02, 0.0, 1.0, "m", "difference up to which the device treats D and Prev-D as equal"
    )
    motion_s: float = bounded(
        1.0, 0.1, 60.0, "s", "maximum time of a motion that contradicts the reported phase"
    )


@dataclass(frozen=True, slots=True)
class SensorRule(Rule):
    """The device reports a broken sensor, or a sensor's value is frozen."""

    reaction: Level = Level.PAUSE
    then: Level = Level.PAUSE


@dataclass(frozen=True, slots=True)
class ResetRule(Rule):
    """The device has rebooted."""


@dataclass(frozen=True, slots=True)
class SuperviseSettings:
    """Settings of all rules, pauses and slow driving."""

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
    slow_factor: float = bounded(0.5, 0.05, 1.0, "1", "factor of all speeds in slow driving")
    slow_for_s: float = bounded(
        5.0, 0.1, MAX_SECONDS, "s", "time of slow driving after its last cause"
    )
    pause_limit_s: float = bounded(
        60.0, 1.0, MAX_SECONDS, "s", "maximum time of a pause before it becomes a stop"
    )

    @property
    def rules(self) -> dict[str, Rule]:
        """Rules by name."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, Rule)}


PREFIX = "supervise"


class PluggedRule(Rule):
    """Base of a plug-in's rule: a frozen dataclass with one field for each key of its table.

    An entry point of the group ``sweepctl.rules`` refers to the class, and its name is the rule's
    name. Declare numbers with :func:`limited`.
    """

    __slots__ = ()

    def condition(self, model: RobotModel) -> object:
        """Return a :class:`bridge.supervise.rules.conditions.Condition` for this robot."""
        raise NotImplementedError


limited = bounded
"""Function that declares a number of a rule: default, minimum, maximum, unit and meaning."""


@functools.cache
def default_settings() -> SuperviseSettings:
    """Return the defaults of every rule: the project's own rules, and the rules of plug-ins."""
    own = {field.name for field in dataclasses.fields(SuperviseSettings)}
    made: list[tuple[str, type, Any]] = []
    for plugin, kind in sweepctl_plugins.usable("rules"):
        wrong, rule = _plugged(plugin.name, kind, own)
        if rule is None:
            sweepctl_plugins.disable(f"{plugin} {wrong}")
        else:
            made.append((plugin.name, kind, field(default=rule)))
            RULE_PLUGINS[plugin.name] = str(plugin)
    if not made:
        return SuperviseSettings()
    extended = dataclasses.make_dataclass(
        "SuperviseSettings", made, bases=(SuperviseSettings,), frozen=True, slots=True
    )
    return cast("SuperviseSettings", extended())


RULE_PLUGINS: dict[str, str] = {}
"""Map of a plug-in's rule to the name of the plug-in, for messages."""


def _plugged(name: str, kind: object, own: set[str]) -> tuple[str, PluggedRule | None]:
    """Return an error text if a plug-in is not a valid rule, and its default settings."""
    if not name.isidentifier():
        return "needs a name of letters, digits and underscores", None
    if name in own:
        return "has a name that is taken", None
    if not isinstance(kind, type) or not issubclass(kind, PluggedRule):
        return "is no subclass of PluggedRule", None
    if kind.condition is PluggedRule.condition:
        return "lacks condition()", None
    try:
        return "", kind()
    except Exception as error:  # noqa: BLE001 - a plug-in may raise anything
        return f"raised {type(error).__name__}: {error}", None


def settings_from(table: object, base: SuperviseSettings | None = None) -> SuperviseSettings:
    """Read the table ``[supervise]`` of a robot file over ``base`` (None: the defaults).

    Raises:
        ConfigError: an unknown key or an invalid value; the text names the key.

    """
    if not isinstance(table, dict):
        raise ConfigError(f"{PREFIX}: must be a table")
    problems: list[str] = []
    settings = fill(base or default_settings(), table, f"{PREFIX}.", problems)
    if problems:
        raise ConfigError(*problems)
    return settings


def parse_rule(settings: SuperviseSettings, text: str) -> SuperviseSettings:
    """Apply one setting in text form, ``stall.reaction=pause`` or ``pause_limit_s=20``.

    Raises:
        ConfigError: an unknown key or an invalid value.

    """
    path, equals, value = text.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        raise ConfigError(f"{text[:80]!r}: use RULE.KEY=VALUE, for example stall.reaction=pause")
    try:
        parsed: Any = tomllib.loads(f"value = {value.strip()}")["value"]
    except (ValueError, RecursionError):
        parsed = value.strip()  # a word without quotes, for example pause
    for key in reversed(keys):
        parsed = {key: parsed}
    return settings_from(parsed, settings)
