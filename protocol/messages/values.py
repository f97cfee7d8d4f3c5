"""Enumerations that messages use."""

from __future__ import annotations

from enum import IntEnum, IntFlag


class Mode(IntEnum):
    """Mode: the source of motion."""

    IDLE = 0
    """Motors are off."""
    VELOCITY = 1
    """The host's cyclic velocity setpoints."""
    BRINGUP = 2
    """Wheel duties set by the operator and limited; the wheels are off the floor."""
    ONBOARD = 3
    """The device's own planner."""


class StopCause(IntEnum):
    """Cause of a latched stop, in ascending severity."""

    NONE = 0
    SESSION_END = 1
    """Clean end of a session, and the state at power-on; motion commands clear only this."""
    LINK = 2
    """The host fell silent or was replaced while no stop was latched."""
    SUPERVISE = 3
    """A supervision rule on the host."""
    OPERATOR = 4
    HARDWARE = 5
    """The device's own fault handling."""


def by_severity() -> list[StopCause]:
    """Causes of a stop in ascending severity, which is the order of their values."""
    return sorted(cause for cause in StopCause if cause is not StopCause.NONE)


def latched_cause(held: int, cause: int) -> StopCause:
    """Cause that a device latches for a stop with ``cause`` while ``held`` is latched.

    It is the more severe cause, which has the greater value. So a clean end or a lost link never
    hides an operator's stop. An unknown cause and ``NONE`` count as ``OPERATOR``.
    """
    return StopCause(max(held, cause if cause in by_severity() else StopCause.OPERATOR))


class Fault(IntFlag):
    """Conditions in the status message: faults, and two states that are not faults."""

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
    """The left wheel counts against the sign of its duty."""
    ENCODER_RIGHT_REVERSED = 1 << 10
    """The right wheel counts against the sign of its duty."""
    ENCODERS_SWAPPED = 1 << 11
    """The duty of one wheel gives counts on the other."""
    CLOCK = 1 << 12
    """The crystal does not run. The device uses a 1 % oscillator and does not send on CAN."""
    BUMPER = 1 << 13
    """A bumper switch stays pressed without other evidence of contact."""
    LIMITED = 1 << 14
    """Not a fault: a reflex of the device limits the speed below the setpoint."""
    DRIVERS_OFF = 1 << 15
    """Not a fault: the motor drivers are disabled."""


class ResetCause(IntEnum):
    """Cause of the last reset."""

    POWER_ON = 0
    PIN = 1
    SOFTWARE = 2
    WATCHDOG = 3
    BROWN_OUT = 4
    CRASH = 5
    """A processor fault or an unexpected interrupt; the crash record follows as a log line."""


class Capability(IntFlag):
    """Features of the device."""

    ENCODERS = 1 << 0
    IMU = 1 << 1
    ULTRASONIC = 1 << 2
    INFRARED = 1 << 3
    BUMPER = 1 << 4
    CLIFF = 1 << 5
    ONBOARD_PLANNER = 1 << 6
    AUTHENTICATION = 1 << 7
    """A key is set: every message that moves the robot or changes a setting needs a tag."""


class Contact(IntFlag):
    """Contact and cliff bits of the range message."""

    BUMPER_LEFT = 1 << 0
    BUMPER_RIGHT = 1 << 1
    CLIFF = 1 << 2


class NackReason(IntEnum):
    """Reason for rejecting a command."""

    UNKNOWN_COMMAND = 0
    BAD_VALUE = 1
    NO_SESSION = 2
    """No host has opened a session with the device."""
    STOP_LATCHED = 3
    OTHER_CAUSE = 4
    """The latched stop has a different cause than the one to clear."""
    FAULT = 5
    """The condition that stopped the device is still present."""
    UNSUPPORTED = 6
    """The device lacks the feature that the command needs (``hello.capabilities``)."""
    READ_ONLY = 7
    UNKNOWN_PARAMETER = 8
    OTHER_MODE = 9
    """The command is not allowed in the current mode."""
    NOT_AUTHENTICATED = 10
    """A key is set and the command has no valid tag."""
    NOT_SAVED = 11
    """The flash memory does not return what was written."""


class ParameterKind(IntEnum):
    """Type of a parameter's 32-bit value."""

    U32 = 0
    F32 = 2
    """IEEE 754 binary32."""


class ParameterFlag(IntFlag):
    """State of a parameter's value."""

    STORED = 1 << 0
    """The value survives a reset."""
    CHANGED = 1 << 1
    """The value differs from the stored one."""
    READ_ONLY = 1 << 2
    NEEDS_REBOOT = 1 << 3
    """A change takes effect at the next boot."""


class PlannerAction(IntEnum):
    """Action for the device's own planner."""

    START = 0
    PAUSE = 1
    RESUME = 2
    ABORT = 3


class OnboardPlanner(IntEnum):
    """Planners that a device may offer."""

    PAPER = 0
    RECOVERY = 1
    U_SHAPE = 2
    RANDOM = 3


class PlannerPhase(IntEnum):
    """Phase of the device's own planner."""

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
    """Kind of reboot."""

    NORMAL = 0
    FACTORY_RESET = 1
    """Stored parameters are erased."""


class LogLevel(IntEnum):
    """Severity of a log text."""

    DEBUG = 0
    INFO = 1
    WARNING = 2
    ERROR = 3


NO_FAULTS = Fault.LIMITED | Fault.DRIVERS_OFF
"""Bits of ``status.faults`` that are no faults."""


def label(enum: type[IntEnum], value: int) -> str:
    """Name of the value in lower case, or ``unknown(7)``; never raises."""
    try:
        return enum(value).name.lower()
    except ValueError:
        return f"unknown({value})"


def flag_labels(flags: type[IntFlag], value: int) -> list[str]:
    """Names of the set bits; an unknown bit as ``bit13``."""
    return [
        (flags(1 << bit).name or f"bit{bit}").lower()
        for bit in range(value.bit_length())
        if value >> bit & 1
    ]


def fault_labels(bits: int) -> list[str]:
    """Names of the faults in ``status.faults``."""
    return flag_labels(Fault, bits & ~int(NO_FAULTS))
