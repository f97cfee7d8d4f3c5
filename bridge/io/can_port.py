"""CAN ports through python-can: slcan adapters, SocketCAN, UDP multicast, in-process buses.

Each frame is a record of 16 bytes (:data:`protocol.can.frames.RECORD`).
"""

from __future__ import annotations

import errno
import time
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Self

import can
from can.interfaces.slcan import slcanBus

from bridge.errors import PortBusyError, PortError
from bridge.io.device_lock import DeviceLock
from bridge.io.multicast import MulticastBus
from bridge.io.port_failure import reason
from bridge.io.port_names import CAN_EXAMPLE
from bridge.io.readable import SELECTED, readable
from bridge.io.waker import Waker
from protocol.can.frames import RECORD

if TYPE_CHECKING:
    from types import TracebackType

DEFAULT_BITRATE = 500_000
"""Default bit rate of an adapter, bit/s."""
SEND_TIMEOUT_S = 0.02
"""Maximum time to send one frame, s. It is one control period. If sending takes longer, the bus is
reported as full."""
POLL_S = 0.02
"""Poll interval for a bus that ``select`` does not support, s."""
ECHOES = 512
"""Maximum number of own frames that the port expects back from an echoing interface."""
READ_FRAMES = 1024
"""Maximum number of frames of one read."""
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
_FULL = frozenset({errno.ENOBUFS, errno.EAGAIN, errno.EWOULDBLOCK})
_WITHOUT_BITRATE = frozenset({"socketcan", "udp_multicast", "virtual"})
"""Interfaces without a bit rate, or whose bit rate ``ip link`` sets."""
_MULTICAST = "udp_multicast"


def split_port(port: str) -> tuple[str, str]:
    """Split ``can:INTERFACE:CHANNEL`` into interface and channel.

    Raises:
        PortError: one of them is missing.

    """
    _, _, rest = port.partition(":")
    interface, _, channel = rest.partition(":")
    if not interface or not channel:
        raise PortError(
            f"{port} is not a CAN port: use can:INTERFACE:CHANNEL, for example {CAN_EXAMPLE}"
        )
    return interface, channel


class CanPort:
    """A CAN bus on which this process is the host."""

    def __init__(self, port: str, *, bitrate: int = DEFAULT_BITRATE, lan: bool = False) -> None:
        """Open ``can:INTERFACE:CHANNEL``.

        Args:
            port: Name of the port.
            bitrate: Bit rate of the adapter, bit/s; ignored by interfaces without a setting for it.
            lan: Let a UDP multicast bus leave this machine.

        Raises:
            PortBusyError: another program uses the adapter.
            PortError: unknown interface or channel, or no permission.

        """
        self.name = port
        interface, channel = split_port(port)
        options: dict[str, Any] = {}
        if interface not in _WITHOUT_BITRATE:
            options["bitrate"] = bitrate
        if interface == _MULTICAST:
            options["lan"] = lan
        self._lock: DeviceLock | None = None
        if interface == "slcan":
            # Lock the device before python-can opens it, because its first bytes would close
            # another host's bus.
            self._lock = DeviceLock(channel.split("@")[0])
            options["sleep_after_open"] = 0.0  # python-can waits 2 s for a board's reset
        self._waker = Waker()
        try:
            if interface != _MULTICAST:
                _check_number(port, self._waker.fd)
            self._bus = _open(port, interface, channel, options)
        except PortError:
            self._unlock()
            self._waker.close()
            raise
        self._echoes: deque[bytes] | None = (
            deque(maxlen=ECHOES) if interface == _MULTICAST else None
        )
        self._woken = False
        self.garbled = 0
        """Number of adapter lines or datagrams that are not frames."""
        self._fd = -1
        with suppress(NotImplementedError, can.CanError):
            self._fd = self._bus.fileno()

    # ---- byte port --------------------------------------------------------------------------

    def wait(self, timeout_s: float) -> bytes:
        """Return the frames that arrive within the time; none at a timeout or wake.

        Raises:
            PortError: the bus is gone.

        """
        if self._fd < 0:
            return self._wait_polling(timeout_s)
        try:
            ready = readable([self._fd, self._waker.fd], max(0.0, timeout_s))
            if self._waker.fd in ready:
                self._waker.drain()
            records: list[bytes] = []
            for _ in range(READ_FRAMES):  # invalid frames count too, to limit the time
                if self._fd not in ready:
                    break
                self._take(self._receive(0.0), records)
                ready = readable([self._fd], 0.0)
        except (can.CanError, OSError, TypeError) as error:
            raise PortError(f"{self.name} is gone: {reason(error)}") from None
        return b"".join(records)

    def _wait_polling(self, timeout_s: float) -> bytes:
        records: list[bytes] = []
        end_s = time.monotonic() + timeout_s
        try:
            while not records and not self._woken:
                left_s = end_s - time.monotonic()
                self._take(self._receive(min(POLL_S, max(0.0, left_s))), records)
                if left_s <= 0:
                    break
            self._woken = False
            while records and len(records) < READ_FRAMES:
                message = self._receive(0.0)
                if message is None:
                    break
                self._take(message, records)
        except (can.CanError, OSError) as error:
            raise PortError(f"{self.name} is gone: {reason(error)}") from None
        return b"".join(records)

    def _receive(self, timeout_s: float) -> can.Message | None:
        try:
            return self._bus.recv(timeout_s)
        except can.CanError as error:
            cause = error.__cause__
            if cause is None or isinstance(cause, OSError):
                raise
            self.garbled += 1  # the bus works; this line is not a frame
            if isinstance(cause, UnicodeDecodeError) and isinstance(self._bus, slcanBus):
                self._bus.flush()  # otherwise python-can keeps the text and fails again
        except (ValueError, IndexError):  # a truncated line
            self.garbled += 1
        return None

    def _take(self, message: can.Message | None, records: list[bytes]) -> None:
        if message is None or message.is_fd:
            return
        record = to_bytes(message)
        if self._echoes and record in self._echoes:
            self._echoes.remove(record)
            return
        records.append(record)

    def write(self, data: bytes) -> int:
        """Send the frames that the bus accepts without delay; return their number of bytes.

        Raises:
            PortError: the bus is gone.

        """
        written = 0
        while written + RECORD.size <= len(data):
            record = data[written : written + RECORD.size]
            if self._echoes is not None:
                self._echoes.append(record)
            try:
                self._bus.send(from_bytes(record), SEND_TIMEOUT_S)
            except can.CanError as error:
                if self._echoes:
                    self._echoes.pop()
                if _is_full(error):
                    break
                raise PortError(f"{self.name} is gone: {reason(error)}") from None
            except OSError as error:
                raise PortError(f"{self.name} is gone: {reason(error)}") from None
            written += RECORD.size
        return written

    def wake(self) -> None:
        """End a wait now. It is safe in a signal handler."""
        self._woken = True
        self._waker.wake()

    def close(self) -> None:
        """Close the bus."""
        with suppress(can.CanError, OSError, TypeError):
            self._bus.shutdown()
        self._unlock()
        self._waker.close()

    def _unlock(self) -> None:
        if self._lock is not None:
            self._lock.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def to_bytes(message: can.Message) -> bytes:
    """Convert a python-can frame to a record of 16 bytes."""
    word = (
        message.arbitration_id
        | (_EXTENDED if message.is_extended_id else 0)
        | (_REMOTE if message.is_remote_frame else 0)
        | (_ERROR if message.is_error_frame else 0)
    )
    return RECORD.pack(word, min(message.dlc, 8), bytes(message.data or b"")[:8])


def from_bytes(record: bytes) -> can.Message:
    """Convert a record of 16 bytes to a python-can data frame."""
    can_id, length, data = RECORD.unpack(record)
    return can.Message(arbitration_id=can_id, data=data[:length], is_extended_id=False)


def _check_number(port: str, newest_fd: int) -> None:
    """Check that the next descriptor is in the range of python-can's ``select``.

    Raises:
        PortError: it is not.

    """
    if newest_fd >= SELECTED:
        raise PortError(
            f"cannot open {port}: this process has {SELECTED} or more open files, which "
            "python-can does not support; close some of them"
        )


def _open(port: str, interface: str, channel: str, options: dict[str, Any]) -> can.BusABC:
    if interface not in can.VALID_INTERFACES:
        raise PortError(
            f"cannot open {port}: unknown CAN interface {interface!r}; use slcan, socketcan, "
            "udp_multicast or another interface of python-can"
        )
    try:
        if interface == _MULTICAST:
            return MulticastBus(channel, **options)
        return can.Bus(interface=interface, channel=channel, ignore_config=True, **options)
    except can.CanInterfaceNotImplementedError as error:
        raise PortError(f"cannot open {port}: {reason(error)}") from None
    except Exception as error:  # noqa: BLE001 - any driver error, such as a missing library
        cause: BaseException = error.__cause__ or error
        number = getattr(cause, "errno", None)
        if number in {errno.EBUSY, errno.EAGAIN}:
            raise PortBusyError(port, None) from None
        if interface == "socketcan":
            raise PortError(
                f"cannot open {port}: {reason(cause)}; check that 'ip link' shows {channel} as up"
            ) from None
        if interface == _MULTICAST and number in {errno.ENODEV, errno.ENETUNREACH}:
            raise PortError(
                f"cannot open {port}: {reason(cause)}; multicast needs a route "
                "(ip route add 224.0.0.0/4 dev lo)"
            ) from None
        raise PortError(f"cannot open {port}: {reason(cause)}") from None


def _is_full(error: can.CanError) -> bool:
    if isinstance(error, can.CanTimeoutError):
        return True
    cause = error.__cause__
    if type(cause).__name__ == "SerialTimeoutException":
        return True
    return error.error_code in _FULL or getattr(cause, "errno", None) in _FULL
