"""Names of the values that messages carry."""

from __future__ import annotations

from enum import IntEnum, IntFlag


class Mode(IntEnum):
    """What moves the wheels."""

    IDLE = 0
    """Nothing: motors are off."""
    VELOCITY = 1
    """The host's cyclic velocity setpoints."""
    BRINGUP = 2
    """Wheel duties set by hand, capped, wheels off the floor."""
    ONBOARD = 3
    """The device's own planner."""


class StopCause(IntEnum):
    """Why a stop is latched, from the least grave cause to the gravest one."""

    NONE = 0
    SESSION_END = 1
    """An orderly end, and the state at power-on: the one cause that a motion command clears."""
    LINK = 2
    """The host fell silent or was replaced while the robot was free to move."""
    SUPERVISE = 3
    """A rule of the host's supervision."""
    OPERATOR = 4
    HARDWARE = 5
    """The device's own fault handling."""


def by_gravity() -> list[StopCause]:
    """Causes of a stop from the least grave to the gravest; their values rise with gravity."""
    return sorted(cause for cause in StopCause if cause is not StopCause.NONE)


def latched_cause(held: int, cause: int) -> StopCause:
    """What a device has latched after a stop of ``cause`` where ``held`` was latched.

    The graver cause: the greater value. An operator's stop is never hidden by an orderly end or
    a lost link. A cause without a name, and none at all, count as the operator's.
    """
    return StopCause(max(held, cause if cause in by_gravity() else StopCause.OPERATOR))


class Fault(IntFlag):
    """Conditions that the status message reports: faults, and what the device does about them."""

    IMU = 1 << 0
    ENCODER_LEFT = 1 << 1
    ENCODER_RIGHT = 1 << 2
    ULTRASONIC = 1 << 3
    INFRARED = 1 << 4
    MOTOR_STALL = 1 << 5
    BATTERY_LOW = 1 << 6
    SETPOINT_EXPIRED = 1 << 7
    LIFTED = 1 << 8
    ENCODER_LEFT_REVERSED = 1 << 9
    """The left wheel counts against its duty."""
    ENCODER_RIGHT_REVERSED = 1 << 10
    """The right wheel counts against its duty."""
    ENCODERS_SWAPPED = 1 << 11
    """The duty of one side gives counts on the other."""
    CLOCK = 1 << 12
    """The crystal does not run: the device keeps time by a 1 % oscillator, and stays off CAN."""
    BUMPER = 1 << 13
    """A switch stays pressed without other evidence of contact."""
    LIMITED = 1 << 14
    """No fault: a reflex of the device holds the speed below what is asked for."""
    DRIVERS_OFF = 1 << 15
    """No fault: the motor drivers are disabled."""


class ResetCause(IntEnum):
    """Why the device booted."""

    POWER_ON = 0
    PIN = 1
    SOFTWARE = 2
    WATCHDOG = 3
    BROWN_OUT = 4
    CRASH = 5
    """A fault of the processor, or an unexpected interrupt; a log line gives the record."""


class Capability(IntFlag):
    """What the device has."""

    ENCODERS = 1 << 0
    IMU = 1 << 1
    ULTRASONIC = 1 << 2
    INFRARED = 1 << 3
    BUMPER = 1 << 4
    CLIFF = 1 << 5
    ONBOARD_PLANNER = 1 << 6
    AUTHENTICATION = 1 << 7
    """A key is set: whatever moves the robot or changes it needs a tag."""


class Contact(IntFlag):
    """Contact and cliff bits of the range message."""

    BUMPER_LEFT = 1 << 0
    BUMPER_RIGHT = 1 << 1
    CLIFF = 1 << 2


class NackReason(IntEnum):
    """Why a command was rejected."""

    UNKNOWN_COMMAND = 0
    BAD_VALUE = 1
    NO_SESSION = 2
    """No host has opened a session with the device."""
    STOP_LATCHED = 3
    OTHER_CAUSE = 4
    """The latched stop has another cause than the one to be cleared."""
    FAULT = 5
    """The condition that stopped the device still holds."""
    UNSUPPORTED = 6
    """The device lacks what the command needs; its hello's capabilities say so."""
    READ_ONLY = 7
    UNKNOWN_PARAMETER = 8
    OTHER_MODE = 9
    """The command needs another mode."""
    NOT_AUTHENTICATED = 10
    """A key is set, and the command came without its tag."""
    NOT_SAVED = 11
    """What was written to the flash does not read back."""


class ParameterKind(IntEnum):
    """How a parameter's 32 bits are read."""

    U32 = 0
    F32 = 2
    """IEEE 754 binary32."""


class ParameterFlag(IntFlag):
    """What is true of a parameter's value now."""

    STORED = 1 << 0
    """The value survives a reset."""
    CHANGED = 1 << 1
    """The value differs from the stored one."""
    READ_ONLY = 1 << 2
    NEEDS_REBOOT = 1 << 3
    """A change counts from the next boot on."""


class PlannerAction(IntEnum):
    """What to do with the device's own planner."""

    START = 0
    PAUSE = 1
    RESUME = 2
    ABORT = 3


class OnboardPlanner(IntEnum):
    """Planners that a device may have."""

    PAPER = 0
    RECOVERY = 1
    U_SHAPE = 2
    RANDOM = 3


class PlannerPhase(IntEnum):
    """What the device's own planner is doing."""

    IDLE = 0
    LANE = 1
    TURN = 2
    STEP = 3
    RECOVERY_BACK = 4
    RECOVERY_LANE = 5
    RECOVERY_RETURN = 6
    PAUSED = 7
    FINISHED = 8
    ABORTED = 9


class RebootKind(IntEnum):
    """How to boot."""

    NORMAL = 0
    FACTORY_RESET = 1
    """Stored parameters are forgotten."""


class LogLevel(IntEnum):
    """Severity of a log text."""

    DEBUG = 0
    INFO = 1
    WARNING = 2
    ERROR = 3


NO_FAULTS = Fault.LIMITED | Fault.DRIVERS_OFF
"""Bits of the status message that a device in order sets too."""


def label(enum: type[IntEnum], value: int) -> str:
    """The value's name in lower case, or ``unknown(7)``; never raises."""
    try:
        return enum(value).name.lower()
    except ValueError:
        return f"unknown({value})"


def flag_labels(flags: type[IntFlag], value: int) -> list[str]:
    """Names of the bits that are set; a bit without a name as ``bit13``."""
    return [
        (flags(1 << bit).name or f"bit{bit}").lower()
        for bit in range(value.bit_length())
        if value >> bit & 1
    ]


def fault_labels(bits: int) -> list[str]:
    """Names of the faults among the bits of a status message."""
    return flag_labels(Fault, bits & ~int(NO_FAULTS))
