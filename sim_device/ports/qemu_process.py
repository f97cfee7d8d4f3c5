"""A QEMU child process that emulates the chip."""

from __future__ import annotations

import ctypes
import json
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from contextlib import suppress
from typing import TYPE_CHECKING

from sim_device.ports.base import PortUnavailableError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

PROGRAM = "qemu-system-arm"
MACHINE = "netduinoplus2"
"""QEMU machine: an STM32F405 with a Cortex-M4."""
END_S = 5.0
_PR_SET_PDEATHSIG = 1
_READ = 65_536
_BACKLOG = 65_536
"""Maximum number of bytes stored for a chip that does not read; further bytes are lost, as in an
adapter."""


class QemuGoneError(PortUnavailableError):
    """QEMU cannot be started, or has ended by itself; the message is one line for the user."""


class ChipLink:
    """Our end of a serial link to the chip; its methods never block."""

    def __init__(self) -> None:
        ours, self.theirs = socket.socketpair()
        ours.setblocking(False)  # noqa: FBT003 - positional in C
        self._socket = ours
        self._waiting = bytearray()
        self.gone = False

    def fileno(self) -> int:
        """Return a file descriptor that becomes readable when the chip sends data or QEMU ends."""
        return self._socket.fileno()

    def write(self, data: bytes) -> None:
        """Send bytes; store the bytes that cannot be sent yet."""
        self._waiting += data[: _BACKLOG - len(self._waiting)]
        if self._waiting:
            with suppress(BlockingIOError, InterruptedError, BrokenPipeError, ConnectionError):
                del self._waiting[: self._socket.send(self._waiting)]

    def read(self) -> bytes:
        """Return all received bytes."""
        if self._waiting:
            self.write(b"")
        data = b""
        with suppress(BlockingIOError, InterruptedError):
            try:
                while chunk := self._socket.recv(_READ):
                    data += chunk
            except ConnectionError:
                pass
            self.gone = True  # empty data: the end of the stream
        return data

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()
        self.theirs.close()


def find_qemu() -> str:
    """Return the path of the program.

    Raises:
        QemuGoneError: QEMU is not installed; the message describes the installation.

    """
    if sys.platform == "win32":
        raise QemuGoneError("--target qemu needs Linux or macOS")
    path = shutil.which(PROGRAM)
    if path is None:
        raise QemuGoneError(
            f"{PROGRAM} is not installed, and --target qemu runs in it "
            "(Debian: apt install qemu-system-arm)"
        )
    return path


class QemuProcess:
    """QEMU with a firmware, controlled over QMP. ``wire`` is USART1, ``plant`` is USART2."""

    def __init__(self, firmware: Path) -> None:
        """Start QEMU; the chip runs at once.

        Raises:
            QemuGoneError: QEMU is not installed or cannot be started.

        """
        program = find_qemu()
        self.wire, self.plant, self._orders = ChipLink(), ChipLink(), ChipLink()
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
        links = {"wire": self.wire, "plant": self.plant, "orders": self._orders}
        command = [program, "-M", MACHINE, "-nodefaults", "-display", "none"]
        for name, link in links.items():
            command += ["-chardev", f"socket,id={name},fd={link.theirs.fileno()}"]
        command += ["-serial", "chardev:wire", "-serial", "chardev:plant"]
        command += ["-mon", "chardev=orders,mode=control", "-kernel", str(firmware)]
        try:
            self._process = subprocess.Popen(  # noqa: S603 - our own command
                command,
                stdin=subprocess.DEVNULL,
                stdout=self._said,
                stderr=self._said,
                pass_fds=[link.theirs.fileno() for link in links.values()],
                start_new_session=True,  # Ctrl-C is for this process, which then ends QEMU
                preexec_fn=_end_with_parent(),  # noqa: PLW1509 - one system call, no lock, no memory
            )
        except OSError as error:
            self._close_links()
            self._said.close()
            raise QemuGoneError(f"cannot start {program}: {error.strerror}") from None
        for link in links.values():
            link.theirs.close()
        self._order("qmp_capabilities")

    @property
    def pid(self) -> int:
        """Process id of QEMU."""
        number: int = self._process.pid
        return number

    def filenos(self) -> list[int]:
        """File descriptors that become readable when there is work."""
        return [self.wire.fileno(), self.plant.fileno()]

    def check(self) -> None:
        """Read QEMU's messages and check that QEMU runs.

        Raises:
            QemuGoneError: QEMU has ended.

        """
        self._orders.read()
        if self.wire.gone or self.plant.gone or self._process.poll() is not None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(1.0)
            self._said.seek(0)
            lines = self._said.read().decode(errors="replace").strip().splitlines()
            # After a crash, QEMU prints the cause before many lines with registers.
            lines = [line for line in lines if line.startswith("qemu")] or lines
            why = lines[0] if lines else f"status {self._process.returncode}"
            raise QemuGoneError(f"QEMU has ended by itself: {why}")

    def reset(self) -> None:
        """Reset the chip."""
        self._order("system_reset")

    def halt(self) -> None:
        """Pause the chip and its clock."""
        self._order("stop")

    def resume(self) -> None:
        """Continue the chip and its clock after :meth:`halt`."""
        self._order("cont")

    def close(self) -> None:
        """End QEMU and remove its files."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._close_links()
        self._said.close()

    def _order(self, what: str) -> None:
        self._orders.write(json.dumps({"execute": what}).encode() + b"\n")

    def _close_links(self) -> None:
        for link in (self.wire, self.plant, self._orders):
            link.close()


def _end_with_parent() -> Callable[[], None] | None:
    """Return a function that makes the kernel end QEMU with this process; None if unsupported."""
    if sys.platform != "linux":
        return None
    prctl = ctypes.CDLL(None).prctl

    def ask() -> None:
        prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)

    return ask
