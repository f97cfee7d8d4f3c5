"""The emulator's control socket: change faults and read the true state while it runs.

It is a Unix socket that only its owner may open (mode 0600). A request is one line of text. An
answer is one line of JSON: ``{"ok": true, ...}`` or ``{"ok": false, "error": "..."}``.

``start SPEC``
    starts a fault (at once if SPEC has no time); returns the complete text of the fault
``check SPEC``
    returns the same text as ``start``, but does not start the fault
``clear [KIND]``
    ends all faults, or all faults of a kind; returns their number
``list``
    returns the active and the waiting faults
``truth``
    returns the robot's true pose and the plant's counters
``line``
    returns the numbers of bytes that the link has transferred and lost
"""

from __future__ import annotations

import dataclasses
import json
import os
import socket
import stat
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from sim_device.faults.spec import FaultSpecError
from sim_device.ports.base import PortUnavailableError
from sim_device.ports.folder_lock import folder_locked

if TYPE_CHECKING:
    from pathlib import Path

    from sim_device.rig import Rig

MAX_LINE = 1024
MAX_CLIENTS = 8
ANSWER_TIMEOUT_S = 5.0
MAX_ANSWER = 1 << 20


class ControlServer:
    """Answers requests on the socket; the serving loop calls :meth:`turn`."""

    def __init__(self, path: Path) -> None:
        """Listen on the socket ``path``.

        Raises:
            PortUnavailableError: this system has no Unix sockets, another emulator listens on the
                path, or the path is in use or too long.

        """
        if not hasattr(socket, "AF_UNIX"):
            raise PortUnavailableError("a control socket needs Linux or macOS")
        self.path = path
        self._clients: dict[socket.socket, bytes] = {}
        """Incomplete request line of each client; the client that is idle for the longest time is
        first."""
        with folder_locked(path):
            self._listener = socket.socket(socket.AF_UNIX)
            try:
                self._bind()
            except OSError as error:
                self._listener.close()
                if isinstance(error, PortUnavailableError):
                    raise
                reason = error.strerror or error
                raise PortUnavailableError(
                    f"cannot make the control socket {path}: {reason}"
                ) from None
        self._listener.listen(MAX_CLIENTS)
        self._listener.setblocking(False)  # noqa: FBT003 - positional in C

    def _bind(self) -> None:
        if self.path.is_symlink() or self.path.exists():
            if not stat.S_ISSOCK(self.path.lstat().st_mode):
                raise PortUnavailableError(f"{self.path} exists and is no socket")
            if _has_listener(self.path):
                raise PortUnavailableError(
                    f"another emulator that still runs listens on {self.path}; "
                    "end it, or choose another --control"
                )
            self.path.unlink()
        before = os.umask(0o177)
        try:
            self._listener.bind(str(self.path))
        finally:
            os.umask(before)
        self._made = self.path.stat().st_ino

    def filenos(self) -> list[int]:
        """File descriptors that become readable when :meth:`turn` has work."""
        return [self._listener.fileno(), *(client.fileno() for client in self._clients)]

    def turn(self, rig: Rig) -> None:
        """Read and answer the waiting requests."""
        with suppress(OSError):
            client, _ = self._listener.accept()
            client.setblocking(False)  # noqa: FBT003 - positional in C
            if len(self._clients) >= MAX_CLIENTS:  # an idle client must not block new clients
                longest_idle = next(iter(self._clients))
                del self._clients[longest_idle]
                longest_idle.close()
            self._clients[client] = b""
        for client in list(self._clients):
            self._serve(client, rig)

    def _serve(self, client: socket.socket, rig: Rig) -> None:
        try:
            data = client.recv(MAX_LINE)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            data = b""
        # inserted again below, as the last in the order of idle clients
        *lines, rest = (self._clients.pop(client) + data).split(b"\n")
        self._clients[client] = rest
        for line in lines:
            reply = answer(line.decode(errors="replace"), rig)
            with suppress(OSError):  # client disconnected or does not read: no answer
                client.send(json.dumps(reply).encode() + b"\n")
        if not data or len(rest) > MAX_LINE:
            del self._clients[client]
            client.close()

    def close(self) -> None:
        """Close all connections; remove the socket file unless another process has replaced it."""
        for client in self._clients:
            client.close()
        self._clients.clear()
        self._listener.close()
        with suppress(OSError), folder_locked(self.path):
            if self.path.stat().st_ino == self._made:
                self.path.unlink()


def answer(line: str, rig: Rig) -> dict[str, Any]:  # noqa: PLR0911 - one for each request
    """Execute a request line and return the answer."""
    verb, _, rest = line.strip().partition(" ")
    rest = rest.strip()
    try:
        match verb:
            case "start":
                return {"ok": True, "fault": rig.faults.start(rest).text}
            case "check":
                return {"ok": True, "fault": rig.faults.check(rest).text}
            case "clear":
                return {"ok": True, "cleared": rig.faults.clear(rest or None)}
            case "list":
                return {
                    "ok": True,
                    "active": [spec.text for spec in rig.faults.active],
                    "waiting": [spec.text for spec in rig.faults.waiting],
                }
            case "truth":
                return {"ok": True, "truth": _truth(rig)}
            case "line":
                return {"ok": True, "line": dataclasses.asdict(rig.counts())}
            case _:
                text = f"{verb[:40]!r} is none of start, check, clear, list, truth, line"
                return {"ok": False, "error": text}
    except FaultSpecError as error:
        return {"ok": False, "error": str(error)}


def _truth(rig: Rig) -> dict[str, Any]:
    truth = rig.truth
    return {
        "time_s": truth.tick_ms / 1000.0,
        "x_m": truth.pose.x_m,
        "y_m": truth.pose.y_m,
        "theta_rad": truth.pose.theta_rad,
        "v_m_s": truth.v_m_s,
        "yaw_rate_rad_s": truth.yaw_rate_rad_s,
        "path_m": truth.path_m,
        "collisions": truth.collisions,
        "contact_s": truth.contact_s,
        "energy_wh": truth.energy_wh,
    }


def ask_control(path: Path, line: str) -> dict[str, Any]:
    """Send a request to a running emulator and return its answer.

    Raises:
        PortUnavailableError: no emulator listens on the path, or its answer is invalid.

    """
    if not hasattr(socket, "AF_UNIX"):
        raise PortUnavailableError("a control socket needs Linux or macOS")
    received = b""
    with socket.socket(socket.AF_UNIX) as client:
        client.settimeout(ANSWER_TIMEOUT_S)
        try:
            client.connect(str(path))
            client.sendall(line.encode() + b"\n")
            while not received.endswith(b"\n") and len(received) < MAX_ANSWER:
                data = client.recv(MAX_LINE)
                if not data:
                    break
                received += data
        except OSError as error:
            reason = error.strerror or error
            raise PortUnavailableError(
                f"no emulator answers on {path}: {reason}; was it started with --control {path}?"
            ) from None
    try:
        reply = json.loads(received)
    except (ValueError, RecursionError):
        raise PortUnavailableError(f"what answers on {path} is no emulator") from None
    if not isinstance(reply, dict) or not isinstance(reply.get("ok"), bool):
        raise PortUnavailableError(f"what answers on {path} is no emulator")
    return reply


def _has_listener(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        probe.settimeout(1.0)
        try:
            probe.connect(str(path))
        except (ConnectionRefusedError, FileNotFoundError):
            return False
        except OSError:
            return True
    return True
