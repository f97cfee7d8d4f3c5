"""The virtual board in C (``firmware/board_virtual``) with a firmware library, in this process.

Each access to the chip is one function call; arguments and result are bytes. So a chip in another
process has the same interface (``sim_device.ports.core_process``). This module imports only the
standard library, so that the other process starts quickly.
"""

from __future__ import annotations

import ctypes
import sysconfig
from contextlib import suppress
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

BUILT_IN = Path(__file__).with_name(f"core_library{sysconfig.get_config_var('EXT_SUFFIX')}")
"""Library with the virtual board and the firmware core, built with the package."""
PAYLOAD_MAX = 65_536
"""Maximum length of a payload or a reply, bytes."""
ANSWER_MAX = 10
"""Maximum length of an answer to a request of the chip, bytes."""
VERSION = 2
"""Version of the message layout; it must equal the version in ``board_virtual/chip.h``."""
_SYMBOL = "sweepctl_firmware"
_ASK = ctypes.CFUNCTYPE(None, ctypes.c_uint32)


class Operation(IntEnum):
    """Operation of a chip; ``chip.h`` describes the payloads."""

    BOOT = 1
    POLL = 2
    RECEIVE = 3
    RESET = 4
    FLASH = 5


class Ask(IntEnum):
    """Request of a chip to its caller while the chip's program runs."""

    RANGES = 1
    CONTACTS = 2
    POWER = 3


class FirmwareLibraryError(Exception):
    """A file is not a firmware library for this program, or the file cannot be loaded."""

    def __init__(self, path: Path, reason: str) -> None:
        """Store the file and the reason."""
        self.path, self.reason = path, reason
        super().__init__(f"{path}: {reason}")


class FirmwareCrashError(Exception):
    """A firmware in a child process has ended this process, or does not return from a call."""

    def __init__(self, what: str, output: str, trace: list[str]) -> None:
        """Store the details of the crash.

        Args:
            what: description in one line.
            output: last lines that the process printed, including a sanitizer's report.
            trace: backtrace, one line per function, the innermost first.

        """
        self.output, self.trace = output, trace
        super().__init__(what)

    @property
    def details(self) -> str:
        """Output and backtrace as text."""
        return self.output + "".join(f"  {line}\n" for line in self.trace)


class Chip(Protocol):
    """A virtual board, in this or another process."""

    imu_settings: bytes
    """Registers 0x19 to 0x1C of the board's IMU, as configured by the firmware."""

    def call(self, operation: int, payload: bytes) -> bytes:
        """Execute an operation and return its reply."""

    def close(self) -> None:
        """Release the board."""


class LocalChip:
    """A virtual board in this process."""

    def __init__(self, answer: Callable[[int], bytes], library: Path | None = None) -> None:
        """Load ``library``; None: the built-in core.

        ``answer`` returns the answer to a request of the chip (:class:`Ask`), in the layout of
        ``chip.h``. :meth:`call` calls it, and it must not raise an exception.

        Raises:
            FirmwareLibraryError: the file is not a firmware library.

        """
        board = _board()
        firmware = board.sweepctl_firmware
        if library is not None:
            self._loaded = _load(library)
            try:
                firmware = getattr(self._loaded, _SYMBOL)
            except AttributeError:
                raise FirmwareLibraryError(library, f"it has no function {_SYMBOL}()") from None
        firmware.restype = ctypes.c_void_p
        self._answer = answer
        self._asked = _ASK(self._ask)  # stored here, because C holds no reference
        self._board = board
        self._chip = board.chip_open(firmware(), self._asked)
        if not self._chip:
            raise FirmwareLibraryError(library or BUILT_IN, board.chip_error().decode())
        self._payload = _memory(board.chip_payload(self._chip), PAYLOAD_MAX)
        self._reply = _memory(board.chip_reply(self._chip), PAYLOAD_MAX)
        self._answered = _memory(board.chip_answer(self._chip), ANSWER_MAX)
        self._call = board.chip_call
        self.imu_settings = board.chip_imu_settings(self._chip).to_bytes(4, "little")

    def call(self, operation: int, payload: bytes) -> bytes:
        """Execute an operation and return its reply."""
        length = len(payload)
        self._payload[:length] = payload
        return bytes(self._reply[: self._call(self._chip, operation, length)])

    def close(self) -> None:
        """Free the board's memory."""
        chip, self._chip = self._chip, None
        if chip:
            self._board.chip_close(chip)

    def __del__(self) -> None:
        with suppress(AttributeError):  # the library was not loaded
            self.close()

    def _ask(self, what: int) -> None:
        answer = self._answer(what)
        self._answered[: len(answer)] = answer


def catch_signals() -> None:
    """Print a backtrace if a firmware in this process crashes; the process then ends."""
    _board().chip_catch_signals()


def _memory(address: int, length: int) -> memoryview:
    return memoryview((ctypes.c_ubyte * length).from_address(address)).cast("B")


def _load(path: Path) -> ctypes.CDLL:
    try:
        return ctypes.CDLL(str(path.absolute()))
    except OSError as error:
        raise FirmwareLibraryError(path, str(error).removeprefix(f"{path.absolute()}: ")) from None


_boards: list[ctypes.CDLL] = []
"""The built-in library after it is loaded; empty before."""


def _board() -> ctypes.CDLL:
    if not _boards:
        _boards.append(_declared(_load(BUILT_IN)))
    return _boards[0]


def _declared(board: ctypes.CDLL) -> ctypes.CDLL:
    """Declare the types of the functions of ``chip.h``."""
    pointer, number = ctypes.c_void_p, ctypes.c_uint32
    board.chip_open.restype, board.chip_open.argtypes = pointer, (pointer, _ASK)
    board.chip_error.restype = ctypes.c_char_p
    for function in (board.chip_payload, board.chip_reply, board.chip_answer):
        function.restype, function.argtypes = pointer, (pointer,)
    board.chip_close.restype, board.chip_close.argtypes = None, (pointer,)
    board.chip_call.restype, board.chip_call.argtypes = number, (pointer, number, number)
    board.chip_imu_settings.restype, board.chip_imu_settings.argtypes = number, (pointer,)
    board.chip_version.restype = number
    if board.chip_version() != VERSION:
        raise FirmwareLibraryError(BUILT_IN, "it was built from other sources; reinstall sweepctl")
    return board
