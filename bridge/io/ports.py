"""Serial ports through pyserial, waited on without polling."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, Self

import serial

from bridge.errors import KeyExposedError, PortBusyError, PortError
from bridge.io.device_lock import owner_pid
from bridge.io.port_names import misspelt, tcp_mistake
from bridge.io.readable import readable
from bridge.io.tcp_port import SCHEME, TcpPort
from bridge.io.waker import Waker
from bridge.session.diagnosis import BEGINNING, words_of
from protocol.can.link import CanLink
from protocol.uart.link import Link

if TYPE_CHECKING:
    from types import TracebackType

    from protocol.link import LinkBase

DEFAULT_BAUD = 921_600
READ_SIZE = 65_536


class BytePort(Protocol):
    """What the pump needs of a port."""

    name: str

    def wait(self, timeout_s: float) -> bytes:
        """Bytes that are there, or that come within the time; empty at its end or a wake."""

    def write(self, data: bytes) -> int:
        """Write what the port takes without waiting; how many bytes that was."""

    def wake(self) -> None:
        """End a wait now, from a signal handler or another thread."""

    def close(self) -> None:
        """Give the port back."""


class SerialPort:
    """A device path, ``socket://`` or ``rfc2217://``, owned by this process alone."""

    def __init__(
        self, url: str, *, baud: int = DEFAULT_BAUD, dtr: bool = False, rts: bool = False
    ) -> None:
        """Open the port, DTR and RTS as given (boards reset on them).

        Raises:
            PortBusyError: another program has it.
            PortError: it does not exist, may not be opened, or is no port.

        """
        self.name = url
        self.low_latency = False
        self._beginning = b""
        """First bytes that came: a port server that refuses gives its reason and hangs up."""
        self._port = _open(url, baud, dtr=dtr, rts=rts)
        self._waker = Waker()
        self._fd = self._descriptor()
        """Where it can be selected on: everything but pyserial's own protocols, and Windows."""
        with suppress(OSError, ValueError, NotImplementedError, AttributeError):
            self._port.set_low_latency_mode(True)  # type: ignore[union-attr]  # serial lines have it
            self.low_latency = True
        self.latency_note = None if self.low_latency else _latency_note(url)
        """What to tell of a driver that delays; None where there is nothing to tell."""
        try:
            self._port.timeout = 0 if self._fd is not None else 0.005
            self._port.write_timeout = 0
        except serial.SerialException as error:  # unplugged since
            self.close()
            raise PortError(f"{url} is gone: {_reason(error)}") from None

    def _descriptor(self) -> int | None:
        """The port's own, where it and the wake's can be waited for together."""
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
        """Bytes that are there, or that come within the time; empty at its end or a wake.

        Raises:
            PortError: the port is gone.

        """
        try:
            fd = self._fd
            if fd is None:
                return bytes(self._port.read(max(1, self._port.in_waiting)))
            # Not pyserial's read: it selects once more, and its errors are many words.
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
            raise PortError(f"{self.name} is gone: {_reason(error)}") from None
        if not data:
            raise PortError(self._ended())
        if len(self._beginning) < BEGINNING:
            self._beginning = (self._beginning + data)[:BEGINNING]
        return data

    def _ended(self) -> str:
        """Why the other end hung up: its own reason where it sent one line of text, no more."""
        words = words_of(self._beginning)
        if words is not None and self._beginning.count(b"\n") == 1:
            return f"{self.name}: the peer sent text instead of frames: {words}"
        return f"{self.name} is gone: it was unplugged, or what is behind it ended"

    def write(self, data: bytes) -> int:
        """Write what the port takes without waiting; how many bytes that was.

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
            raise PortError(f"{self.name} is gone: {_reason(error)}") from None

    def wake(self) -> None:
        """End a wait now; safe in a signal handler. A closed port has nobody to wake."""
        self._waker.wake()

    def close(self) -> None:
        """Give the port back."""
        with suppress(OSError):
            self._hang_up()
            self._port.close()
        self._waker.close()

    def _hang_up(self) -> None:
        """Close a socket ourselves: pyserial sleeps 0.3 s after it has."""
        connection = getattr(self._port, "_socket", None)
        if connection is not None:
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
    """Complain of a port on which others could read a key on its way.

    Raises:
        KeyExposedError: it is a bus or a network.

    """
    if is_can(port) or "://" in port:
        raise KeyExposedError(port)


def is_can(port: str) -> bool:
    """Whether a port's name is that of a CAN bus: ``can:INTERFACE:CHANNEL``."""
    return port.startswith("can:")


def link_of(port: str) -> type[LinkBase]:
    """The link to run over a port of this name."""
    return CanLink if is_can(port) else Link


def open_port(  # noqa: PLR0913 - what the two kinds of port can be asked for
    port: str,
    *,
    baud: int = DEFAULT_BAUD,
    dtr: bool = False,
    rts: bool = False,
    bitrate: int | None = None,
    lan: bool = False,
) -> BytePort:
    """Open a serial port, or a bus that ``can:INTERFACE:CHANNEL`` names.

    Raises:
        PortBusyError: another program has it.
        PortError: it does not exist, may not be opened, or is no port.

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
    except Exception as error:  # noqa: BLE001 - its URLs have options, patterns and mistakes
        raise PortError(misspelt(url) or f"{url} is not a port: {_reason(error)}") from None
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
        return PortError(misspelt(url) or f"{url} does not exist; is the robot plugged in?")
    if number == errno.EACCES:
        return PortError(_denied(url))
    if number in {errno.EBUSY, errno.EAGAIN} or "exclusively lock" in str(error):
        return PortBusyError(url, owner_pid(url))
    if number == errno.ENOTTY or "Inappropriate ioctl" in str(error):
        return PortError(f"{url} is not a serial port")
    # pyserial wraps what the system said in words of its own, with the name once more.
    cause = error.__context__ if isinstance(error.__context__, OSError) else error
    return PortError(f"cannot open {url}: {_reason(cause)}")


def _denied(url: str) -> str:
    """What to do where a device may not be opened."""
    group = "dialout"
    try:
        import grp  # noqa: PLC0415 - not on every platform

        group = grp.getgrgid(Path(url).stat().st_gid).gr_name
    except (ImportError, OSError, KeyError):
        pass
    if group == "root":  # no group is let in
        return f"{url}: permission denied; install the udev rule (sweepctl ports --udev-rule)"
    return (
        f"{url}: permission denied; join the group that owns it (sudo usermod -aG {group} $USER, "
        "then log in again), or install the udev rule (sweepctl ports --udev-rule)"
    )


def _latency_note(url: str) -> str | None:
    """Of a driver that has no low-latency mode; a socket and a pty need none."""
    if "://" in url or os.path.realpath(url).startswith("/dev/pts/"):
        return None
    return (
        f"the driver of {url} has no low-latency mode: bytes may wait for up to 16 ms in it, "
        "and the bounds on time stamps are that much wider"
    )


def latency_note(port: BytePort) -> str | None:
    """What to tell of a port whose driver delays; None where there is nothing to tell."""
    note = getattr(port, "latency_note", None)
    return note if isinstance(note, str) else None


def _reason(error: BaseException) -> str:
    strerror = getattr(error, "strerror", None)
    return str(strerror or error).strip().splitlines()[0] if str(error) else type(error).__name__
