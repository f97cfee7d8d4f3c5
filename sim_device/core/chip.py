"""The virtual board in C (``firmware/board_virtual``) with one firmware library, in this process.

Everything that crosses the border is one call with bytes in and bytes out, so that a chip in
another process is called the same way (``sim_device.ports.core_process``). Only the standard
library is needed here: that process starts quickly.
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
"""Virtual board and firmware core, built with the package."""
PAYLOAD_MAX = 65_536
"""Longest payload and longest reply, bytes."""
ANSWER_MAX = 10
"""Longest answer to what a chip asks for, bytes."""
VERSION = 1
"""Of ``board_virtual/chip.h``, whose layout this package holds as well."""
_SYMBOL = "sweepctl_firmware"
_ASK = ctypes.CFUNCTYPE(None, ctypes.c_uint32)


class Operation(IntEnum):
    """What a chip is asked to do; payloads are described in ``chip.h``."""

    BOOT = 1
    POLL = 2
    RECEIVE = 3
    RESET = 4
    FLASH = 5


class Ask(IntEnum):
    """What a chip asks for while its program runs."""

    RANGES = 1
    CONTACTS = 2
    POWER = 3


class LibraryError(Exception):
    """A file is no firmware library for this program, or does not load."""

    def __init__(self, path: Path, reason: str) -> None:
        """Keep the file and what is wrong with it."""
        self.path, self.reason = path, reason
        super().__init__(f"{path}: {reason}")


class FirmwareCrashError(Exception):
    """A firmware in a process of its own has ended it, or does not return from a call."""

    def __init__(self, what: str, output: str, trace: list[str]) -> None:
        """Keep what happened.

        Args:
            what: what happened, in one line.
            output: the last lines that the process printed, among them a sanitizer's report.
            trace: the backtrace, one line for each function, the innermost first.

        """
        self.output, self.trace = output, trace
        super().__init__(what)

    @property
    def details(self) -> str:
        """Output and backtrace as text."""
        return self.output + "".join(f"  {line}\n" for line in self.trace)


class Chip(Protocol):
    """A virtual board, wherever it runs."""

    imu_settings: bytes
    """Registers 0x19 to 0x1C of its IMU, as the firmware's board sets them."""

    def call(self, operation: int, payload: bytes) -> bytes:
        """Let it do something; its reply."""

    def close(self) -> None:
        """Be done with it."""


class LocalChip:
    """A virtual board in this process."""

    def __init__(self, answer: Callable[[int], bytes], library: Path | None = None) -> None:
        """Load ``library``, or take the core that is built in.

        ``answer`` gives what the chip asks for (:class:`Ask`), in the layout of ``chip.h``; it is
        called within :meth:`call` and must not raise.

        Raises:
            LibraryError: the file is no such library.

        """
        board = _board()
        firmware = board.sweepctl_firmware
        if library is not None:
            self._loaded = _load(library)
            try:
                firmware = getattr(self._loaded, _SYMBOL)
            except AttributeError:
                raise LibraryError(library, f"it has no function {_SYMBOL}()") from None
        firmware.restype = ctypes.c_void_p
        self._answer = answer
        self._asked = _ASK(self._ask)  # kept: C holds no reference
        self._board = board
        self._chip = board.chip_open(firmware(), self._asked)
        if not self._chip:
            raise LibraryError(library or BUILT_IN, board.chip_error().decode())
        self._payload = _memory(board.chip_payload(self._chip), PAYLOAD_MAX)
        self._reply = _memory(board.chip_reply(self._chip), PAYLOAD_MAX)
        self._answered = _memory(board.chip_answer(self._chip), ANSWER_MAX)
        self._call = board.chip_call
        self.imu_settings = board.chip_imu_settings(self._chip).to_bytes(4, "little")

    def call(self, operation: int, payload: bytes) -> bytes:
        """Let it do something; its reply."""
        length = len(payload)
        self._payload[:length] = payload
        return bytes(self._reply[: self._call(self._chip, operation, length)])

    def close(self) -> None:
        """Free its memory."""
        chip, self._chip = self._chip, None
        if chip:
            self._board.chip_close(chip)

    def __del__(self) -> None:
        with suppress(AttributeError):  # it was not opened
            self.close()

    def _ask(self, what: int) -> None:
        answer = self._answer(what)
        self._answered[: len(answer)] = answer


def catch_signals() -> None:
    """Let a crash of a firmware in this process print its backtrace before the process ends."""
    _board().chip_catch_signals()


def _memory(address: int, length: int) -> memoryview:
    return memoryview((ctypes.c_ubyte * length).from_address(address)).cast("B")


def _load(path: Path) -> ctypes.CDLL:
    try:
        return ctypes.CDLL(str(path.absolute()))
    except OSError as error:
        raise LibraryError(path, str(error).removeprefix(f"{path.absolute()}: ")) from None


_boards: list[ctypes.CDLL] = []
"""The built-in library, once it is loaded."""


def _board() -> ctypes.CDLL:
    if not _boards:
        _boards.append(_declared(_load(BUILT_IN)))
    return _boards[0]


def _declared(board: ctypes.CDLL) -> ctypes.CDLL:
    """State the types of the functions of ``chip.h``."""
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
        raise LibraryError(BUILT_IN, "it was built of other sources; install sweepctl anew")
    return board
