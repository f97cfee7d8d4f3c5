"""Errors of the host, grouped by the user's remedy. Each error is one line and an exit status."""

from __future__ import annotations

from enum import Enum, IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


class ExitStatus(IntEnum):
    """Exit status of a command, and of a run's end."""

    SUCCESS = 0
    FAILURE = 1
    """The command failed, or a run reached its time limit."""
    USAGE = 2
    """An argument or a settings file is wrong."""
    NO_DEVICE = 3
    """The port cannot be used, or the device does not answer or is lost."""
    REJECTED = 4
    """The device or another process rejected a command, or the device is incompatible."""
    STOPPED = 5
    """The robot was stopped for safety."""


class Remedy(Enum):
    """Remedy for an error, as a code. Each interface has its own text for it.

    The value is the text of the Python interface.
    """

    CLEAR_STOP = ", then call enable(clear_stop=True)"
    """A stop is latched for safety. A person may clear it after a check of the robot."""
    KEY = ": give it as bridge.open(port, key=...)"
    """The robot has a key, but the session does not sign with this key."""
    NODE = "; choose one with bridge.open(port, node=N)"
    """Several devices answer."""
    FORCE = ", or force=True to replace it"
    """The file exists."""


class BridgeError(Exception):
    """Base class of all errors that the host raises itself."""

    exit_status: int = ExitStatus.FAILURE
    remedy: Remedy | None = None
    """Remedy for the error, if any."""

    @property
    def bare(self) -> str:
        """Return the error without the remedy. The command line has its own text for the remedy."""
        return super().__str__()

    def __str__(self) -> str:
        """Return the error and the remedy in the Python interface."""
        return self.bare if self.remedy is None else self.bare + self.remedy.value


class ConfigError(BridgeError):
    """A settings file cannot be used. The text lists every wrong key."""

    exit_status: int = ExitStatus.USAGE

    def __init__(self, *problems: str, source: str = "") -> None:
        """Store the errors.

        Args:
            problems: One text for each error. It starts with the key.
            source: Name of the file, which is the start of the text.

        """
        self.problems = problems
        text = together(problems)
        super().__init__(f"{source}: {text}" if source else text)


MAX_PROBLEMS = 12
"""Maximum number of problems in an error text. A file may have thousands of wrong keys."""


def together(problems: Sequence[str]) -> str:
    """Return several problems as one line."""
    if len(problems) == 1:
        return problems[0]
    left = len(problems) - MAX_PROBLEMS
    rest = f"; and {left} more" if left > 0 else ""
    return f"{len(problems)} problems: {'; '.join(problems[:MAX_PROBLEMS])}{rest}"


class ArgumentError(BridgeError, ValueError):
    """An argument has the wrong type or range. The text has its name, value and valid values."""

    exit_status: int = ExitStatus.USAGE


class ParameterError(BridgeError):
    """A parameter is unknown, or does not accept a value."""

    exit_status: int = ExitStatus.USAGE


class OutputExistsError(BridgeError):
    """The output file exists, and the caller did not request its replacement."""

    remedy: Remedy | None = Remedy.FORCE

    def __init__(self, path: Path, *, can_replace: bool = True) -> None:
        """Create the error. ``can_replace``: the caller has an option to replace the file."""
        super().__init__(f"{path} exists; give another name")
        self.path = path
        if not can_replace:
            self.remedy = None


class PortError(BridgeError):
    """The port cannot be opened or is gone."""

    exit_status: int = ExitStatus.NO_DEVICE


class PortBusyError(PortError):
    """Another program uses the port."""

    def __init__(self, port: str, pid: int | None) -> None:
        owner = f"process {pid}" if pid else "another program"
        super().__init__(f"{port} is busy: {owner} has it open; end it or choose another port")
        self.port = port
        self.pid = pid


class NoOwnerError(PortError):
    """No process of this user has the port open and listens for requests."""


class OwnerRejectedError(BridgeError):
    """The process that owns the port rejected the request."""

    exit_status: int = ExitStatus.REJECTED

    def __init__(self, reason: str, exit_status: int = ExitStatus.REJECTED) -> None:
        super().__init__(reason)
        self.exit_status = exit_status


class NoDeviceError(PortError):
    """The port is open, but no sweeper answers on it."""


class SeveralDevicesError(NoDeviceError):
    """Several devices answer on a bus, and no node was selected."""

    exit_status: int = ExitStatus.USAGE


class DeviceLostError(PortError):
    """The device became silent or its port disappeared, and it did not return."""


class NoAnswerError(DeviceLostError):
    """The device did not answer a command.

    A device ignores commands that another key signed, so the exit status of a signed command is 4.
    """

    def __init__(self, command: str, *, signed: bool) -> None:
        cause = "that the key is the device's key" if signed else "the link"
        super().__init__(f"the device did not answer {command}; check {cause}")
        if signed:
            self.exit_status = ExitStatus.REJECTED


class IncompatibleError(BridgeError):
    """The device is incompatible or rejects the host."""

    exit_status: int = ExitStatus.REJECTED


class CommandRejectedError(BridgeError):
    """The device rejected a command."""

    exit_status: int = ExitStatus.REJECTED

    def __init__(self, command: str, reason: str) -> None:
        super().__init__(f"the device rejected {command}: {reason}")
        self.command = command
        self.reason = reason


class KeyExposedError(BridgeError):
    """A key would be sent over a connection that others can read."""

    exit_status: int = ExitStatus.USAGE

    def __init__(self, port: str) -> None:
        super().__init__(
            f"a key goes over the robot's own serial line only, and {port} is a bus or a network; "
            "nothing was sent"
        )
        self.port = port


class StoppedForSafetyError(BridgeError):
    """The robot is stopped, and a person must clear the stop."""

    exit_status: int = ExitStatus.STOPPED


_SHOWN_BITS = 128
"""Maximum size of an integer that a message shows completely, bits. It has 39 digits, which a
person can still read.
"""
_SHOWN_CHARACTERS = 60
"""Maximum number of characters of a value that a message quotes."""


def shown(value: object) -> str:
    """Return a user's value as text for a message of one line."""
    if isinstance(value, int) and value.bit_length() > _SHOWN_BITS:
        return f"(an integer of {value.bit_length()} bits)"
    text = repr(value)
    return text if len(text) <= _SHOWN_CHARACTERS else f"{text[:_SHOWN_CHARACTERS]}..."
