"""The emulator's control socket: faults switched on and off while it runs, the truth told.

A Unix socket that only its owner may open (mode 0600). One request is one line of text, one
answer one line of JSON, ``{"ok": true, ...}`` or ``{"ok": false, "error": "..."}``:

``start SPEC``
    begins a fault, at once where SPEC names no time; answers with its full text
``check SPEC``
    answers like ``start``, and begins nothing
``clear [KIND]``
    ends the faults of a kind, or all; answers with how many there were
``list``
    the faults that are active and those that wait
``truth``
    where the robot really is, and what the plant has counted
``line``
    what went over the line, and what was lost on it
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
from sim_device.ports.names import folder_locked

if TYPE_CHECKING:
    from pathlib import Path

    from sim_device.rig import Rig

MAX_LINE = 1024
MAX_CLIENTS = 8
ANSWER_TIMEOUT_S = 5.0
MAX_ANSWER = 1 << 20


class ControlServer:
    """Answers on the socket, one turn at a time, from the serving loop."""

    def __init__(self, path: Path) -> None:
        """Listen.

        Raises:
            PortUnavailableError: no Unix sockets on this system, another emulator listens
                there, or the path is taken or too long.

        """
        if not hasattr(socket, "AF_UNIX"):
            raise PortUnavailableError("a control socket needs Linux or macOS")
        self.path = path
        self._clients: dict[socket.socket, bytes] = {}
        """With the beginning of a line each; the one that has been idle the longest first."""
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
            if _somebody_listens(self.path):
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
        """Become readable when :meth:`turn` has something to do."""
        return [self._listener.fileno(), *(client.fileno() for client in self._clients)]

    def turn(self, rig: Rig) -> None:
        """Take what has come, and answer it."""
        with suppress(OSError):
            client, _ = self._listener.accept()
            client.setblocking(False)  # noqa: FBT003 - positional in C
            if len(self._clients) >= MAX_CLIENTS:  # nobody keeps a place by asking nothing
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
        *lines, rest = (self._clients.pop(client) + data).split(b"\n")  # now the last to be idle
        self._clients[client] = rest
        for line in lines:
            reply = answer(line.decode(errors="replace"), rig)
            with suppress(OSError):  # it has left, or does not read: its loss
                client.send(json.dumps(reply).encode() + b"\n")
        if not data or len(rest) > MAX_LINE:
            del self._clients[client]
            client.close()

    def close(self) -> None:
        """Hang up and take the socket's name away, unless it is another's by now."""
        for client in self._clients:
            client.close()
        self._clients.clear()
        self._listener.close()
        with suppress(OSError), folder_locked(self.path):
            if self.path.stat().st_ino == self._made:
                self.path.unlink()


def answer(line: str, rig: Rig) -> dict[str, Any]:  # noqa: PLR0911 - one for each
    """Do what a line asks for."""
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
    """Ask a running emulator; its answer.

    Raises:
        PortUnavailableError: nobody listens there, or the answer is none.

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


def _somebody_listens(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        probe.settimeout(1.0)
        try:
            probe.connect(str(path))
        except (ConnectionRefusedError, FileNotFoundError):
            return False
        except OSError:
            return True
    return True
