"""Serial ports through pyserial. A thread waits for their bytes without polling.

A port without a file descriptor (``rfc2217://``, and any port on Windows) is polled at 200 Hz.
"""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, Self

import serial

from bridge.errors import KeyExposedError, PortBusyError, PortError
from bridge.io.device_lock import owner_pid
from bridge.io.port_failure import reason
from bridge.io.port_names import misspelt, tcp_mistake
from bridge.io.readable import readable
from bridge.io.tcp_port import SCHEME, TcpPort
from bridge.io.waker import Waker
from bridge.session.diagnosis import BEGINNING, text_line
from protocol.can.link import CanLink
from protocol.uart.link import Link

if TYPE_CHECKING:
    from types import TracebackType

    from protocol.link import LinkBase

DEFAULT_BAUD = 921_600
"""Default baud rate of a serial port."""
_RFC2217 = "rfc2217://"
READ_SIZE = 65_536
"""Maximum number of bytes of one read."""


class BytePort(Protocol):
    """Interface of a port for a loop."""

    name: str

    def wait(self, timeout_s: float) -> bytes:
        """Return the bytes that arrive within the time; none at a timeout or wake."""

    def write(self, data: bytes) -> int:
        """Write the bytes that the port accepts without waiting; return their number."""

    def wake(self) -> None:
        """End a wait now, from a signal handler or another thread."""

    def close(self) -> None:
        """Close the port."""


class SerialPort:
    """A device path, ``socket://`` or ``rfc2217://`` port that this process opens exclusively."""

    def __init__(
        self, url: str, *, baud: int = DEFAULT_BAUD, dtr: bool = False, rts: bool = False
    ) -> None:
        """Open the port.

        Args:
            url: Name of the port.
            baud: Baud rate.
            dtr: State of DTR; many boards reset on it.
            rts: State of RTS.

        Raises:
            PortBusyError: another program uses the port.
            PortError: the port does not exist, cannot be opened, or is not a port.

        """
        self.name = url
        self.low_latency = False
        self._beginning = b""
        """First bytes received. A port server sends a rejection as text before it disconnects."""
        self._port = _open(url, baud, dtr=dtr, rts=rts)
        self._waker = Waker()
        self._fd = self._descriptor()
        """Descriptor for waiting; None on Windows and for pyserial's own protocols."""
        with suppress(OSError, ValueError, NotImplementedError, AttributeError):
            self._port.set_low_latency_mode(True)  # type: ignore[union-attr]  # serial ports have it
            self.low_latency = True
        self.latency_note = None if self.low_latency else _latency_note(url)
        """Warning about a driver that delays bytes; None without a delay."""
        try:
            self._port.timeout = 0 if self._fd is not None else 0.005
            if not url.startswith(_RFC2217):  # pyserial has no timeout for writing there
                self._port.write_timeout = 0
        except serial.SerialException as error:  # unplugged
            self.close()
            raise PortError(f"{url} is gone: {reason(error)}") from None

    def _descriptor(self) -> int | None:
        """Return the port's descriptor if a wait can include it and the waker's descriptor."""
        if os.name != "posix":
            return None
        try:
            fd: int = self._port.fileno()
            readable([fd, self._waker.fd], 0.0)
        except (OSError, ValueError, NotImplementedError, AttributeError):
            return None
        os.set_blocking(fd, False)
        return fd

    def wait(self, timeout_s: float) -> bytes:
        """Return the bytes that arrive within the time; none at a timeout or wake.

        Raises:
            PortError: the port is gone.

        """
        try:
            fd = self._fd
            if fd is None:
                return bytes(self._port.read(max(1, self._port.in_waiting)))
            # Do not use pyserial's read, which calls ``select`` again and has verbose errors.
            wanted = [fd, self._waker.fd]
            ready = readable(wanted, max(0.0, timeout_s))
            if self._waker.fd in ready:
                self._waker.drain()
            if fd not in ready:
                return b""
            data = os.read(fd, READ_SIZE)
        except BlockingIOError:
            return b""
        except (OSError, TypeError) as error:  # pyserial: SerialException is an OSError
            raise PortError(f"{self.name} is gone: {reason(error)}") from None
        if not data:
            raise PortError(self._ended())
        if len(self._beginning) < BEGINNING:
            self._beginning = (self._beginning + data)[:BEGINNING]
        return data

    def _ended(self) -> str:
        """Return the reason of a disconnection: the peer's text if it sent exactly one line."""
        words = text_line(self._beginning)
        if words is not None and self._beginning.count(b"\n") == 1:
            return f"{self.name}: the peer sent text instead of frames: {words}"
        return f"{self.name} is gone: it was unplugged, or the program behind it ended"

    def write(self, data: bytes) -> int:
        """Write the bytes that the port accepts without waiting; return their number.

        Raises:
            PortError: the port is gone.

        """
        try:
            if self._fd is not None:
                return os.write(self._fd, data)
            return self._port.write(data) or 0
        except (BlockingIOError, InterruptedError):
            return 0
        except serial.SerialTimeoutException:
            return 0
        except (OSError, TypeError) as error:
            raise PortError(f"{self.name} is gone: {reason(error)}") from None

    def wake(self) -> None:
        """End a wait now. It is safe in a signal handler and has no effect on a closed port."""
        self._waker.wake()

    def close(self) -> None:
        """Close the port."""
        with suppress(OSError):
            self._hang_up()
            self._port.close()
        self._waker.close()

    def _hang_up(self) -> None:
        """Close a socket directly, because pyserial sleeps 0.3 s after closing it."""
        connection = getattr(self._port, "_socket", None)
        if isinstance(self._port, TcpPort) and connection is not None:
            self._port.is_open = False
            connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def check_local(port: str) -> None:
    """Check that others cannot read a key on this port.

    Raises:
        KeyExposedError: the port is a bus or a network.

    """
    if is_can(port) or "://" in port:
        raise KeyExposedError(port)


def is_can(port: str) -> bool:
    """Return True for the name of a CAN bus: ``can:INTERFACE:CHANNEL``."""
    return port.startswith("can:")


def link_of(port: str) -> type[LinkBase]:
    """Return the link class for a port's name."""
    return CanLink if is_can(port) else Link


def open_port(  # noqa: PLR0913 - the options of both kinds of port
    port: str,
    *,
    baud: int = DEFAULT_BAUD,
    dtr: bool = False,
    rts: bool = False,
    bitrate: int | None = None,
    lan: bool = False,
) -> BytePort:
    """Open a serial port or a CAN bus.

    Args:
        port: Device path, ``socket://HOST:PORT``, ``rfc2217://HOST:PORT`` or
            ``can:INTERFACE:CHANNEL``.
        baud: Baud rate of a serial port.
        dtr: State of DTR.
        rts: State of RTS.
        bitrate: Bit rate of a CAN bus, bit/s; None: :data:`DEFAULT_BITRATE`.
        lan: Let a UDP multicast bus leave this machine.

    Raises:
        PortBusyError: another program uses the port.
        PortError: the port does not exist, cannot be opened, or is not a port.

    """
    if not is_can(port):
        return SerialPort(port, baud=baud, dtr=dtr, rts=rts)
    from bridge.io.can_port import DEFAULT_BITRATE, CanPort  # noqa: PLC0415 - 0.1 s to import

    return CanPort(port, bitrate=bitrate or DEFAULT_BITRATE, lan=lan)


def _open(url: str, baud: int, *, dtr: bool, rts: bool) -> serial.Serial | TcpPort:
    mistake = tcp_mistake(url)
    if mistake is not None:
        raise PortError(mistake)
    try:
        port = _unopened(url, baud)
        with suppress(AttributeError, NotImplementedError):
            port.dtr, port.rts = dtr, rts
        if "://" not in url:
            port.exclusive = True
        port.open()
    except (serial.SerialException, OSError) as error:
        raise _open_error(url, error) from None
    except Exception as error:  # noqa: BLE001 - any error of pyserial's URL handlers
        raise PortError(misspelt(url) or f"{url} is not a port: {reason(error)}") from None
    return port


def _unopened(url: str, baud: int) -> serial.Serial | TcpPort:
    if url.lower().startswith(SCHEME):
        port = TcpPort(baudrate=baud)
        port.port = url
        return port
    return serial.serial_for_url(url, baudrate=baud, do_not_open=True)


def _open_error(url: str, error: OSError) -> PortError:
    number = error.errno
    if number == errno.ENOENT:
        return PortError(misspelt(url) or f"{url} does not exist; plug in the robot")
    if number == errno.EACCES:
        return PortError(_denied(url))
    if number in {errno.EBUSY, errno.EAGAIN} or "exclusively lock" in str(error):
        return PortBusyError(url, owner_pid(url))
    if number == errno.ENOTTY or "Inappropriate ioctl" in str(error):
        return PortError(f"{url} is not a serial port")
    # pyserial adds its own text to the system's error and repeats the port's name.
    cause = error.__context__ if isinstance(error.__context__, OSError) else error
    return PortError(f"cannot open {url}: {reason(cause)}")


def _denied(url: str) -> str:
    """Return the error text for a device without permission, with the remedy."""
    group = "dialout"
    try:
        import grp  # noqa: PLC0415 - not on every platform

        group = grp.getgrgid(Path(url).stat().st_gid).gr_name
    except (ImportError, OSError, KeyError):
        pass
    if group == "root":  # no group has access
        return f"{url}: permission denied; install the udev rule (sweepctl ports --udev-rule)"
    return (
        f"{url}: permission denied; join the group that owns it (sudo usermod -aG {group} $USER, "
        "then log in again), or install the udev rule (sweepctl ports --udev-rule)"
    )


def _latency_note(url: str) -> str | None:
    """Return the warning for a driver without low-latency mode; None for sockets and ptys."""
    if "://" in url or os.path.realpath(url).startswith("/dev/pts/"):
        return None
    return (
        f"the driver of {url} has no low-latency mode: it delays bytes by up to 16 ms, "
        "and the error bounds of time stamps are wider by that"
    )


def latency_note(port: BytePort) -> str | None:
    """Return a port's warning about a driver that delays bytes; None without a delay."""
    note = getattr(port, "latency_note", None)
    return note if isinstance(note, str) else None
