"""Requests to the process that owns a port."""

from __future__ import annotations

import json
import socket
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from bridge.errors import NoOwnerError, OwnerRejectedError
from bridge.io.owner_names import NoFolderError, folder, link_names

if TYPE_CHECKING:
    from collections.abc import Iterator
    from io import BufferedReader

ANSWER_TIMEOUT_S = 15.0
"""Maximum wait for an answer, s."""
MAX_ANSWER = 1 << 20
"""Maximum size of an answer, bytes."""
CONNECT_S = 1.0
"""Maximum time for a connection while the owner's queue is full, s."""
_RETRY_S = 0.005
"""Interval of connection attempts, s."""


def ask(
    port: str, request: dict[str, Any], *, timeout_s: float = ANSWER_TIMEOUT_S
) -> dict[str, Any]:
    """Send one request to the owner of a port; return its answer.

    Raises:
        NoOwnerError: the port has no owner, or the owner closed the connection.
        OwnerRejectedError: the owner rejected the request; the text has the reason.

    """
    with _connected(port, timeout_s) as (client, answers):
        _send(port, client, request)
        return _next(port, answers)


def watch(port: str, *, hz: float = 4.0, of: str = "status") -> Iterator[dict[str, Any]]:
    """Yield the robot's state ``hz`` times per second until the owner ends.

    Args:
        port: The port, by any of its names.
        hz: Rate, 0.01 to 50 Hz.
        of: ``status``, or ``dashboard`` for all data that a dashboard shows.

    Raises:
        NoOwnerError: the port has no owner.
        OwnerRejectedError: the owner rejected the request.

    """
    period_s = 1.0 / hz if hz > 0.0 else 0.0  # the owner rejects another rate
    with _connected(port, ANSWER_TIMEOUT_S + period_s) as (client, answers):
        _send(port, client, {"do": "watch", "hz": hz, "of": of})
        yield _part(port, _next(port, answers), of)
        while True:
            try:
                answer = _next(port, answers)
            except NoOwnerError:
                return
            yield _part(port, answer, of)


def _part(port: str, answer: dict[str, Any], name: str) -> dict[str, Any]:
    """Return a part of an answer. An owner with an older version may not send this part."""
    part = answer.get(name)
    if not isinstance(part, dict):
        raise NoOwnerError(f"the owner of {port} is another version of sweepctl")
    return part


def has_owner(port: str) -> bool:
    """Return True if a process accepts requests for this port."""
    try:
        with _connected(port, 1.0):
            return True
    except NoOwnerError:
        return False


@contextmanager
def _connected(port: str, timeout_s: float) -> Iterator[tuple[socket.socket, BufferedReader]]:
    if not hasattr(socket, "AF_UNIX"):
        raise NoOwnerError(f"{port}: the owner cannot be reached without Unix sockets")
    try:
        where = folder()
    except NoFolderError as error:
        raise NoOwnerError(f"{port}: {error}") from None
    with socket.socket(socket.AF_UNIX) as client:
        client.settimeout(timeout_s)
        for name in link_names(port):
            if not _connect(client, str(where / name)):
                continue
            with client.makefile("rb") as answers:
                yield client, answers
            return
    raise NoOwnerError(f"no process of yours has {port} open")


def _connect(client: socket.socket, path: str) -> bool:
    """Connect. If the queue is full, try again, because the listener accepts continuously."""
    for _ in range(round(CONNECT_S / _RETRY_S)):
        try:
            client.connect(path)
        except BlockingIOError:
            time.sleep(_RETRY_S)
        except OSError:
            return False
        else:
            return True
    return False


def _send(port: str, client: socket.socket, request: dict[str, Any]) -> None:
    try:
        client.sendall(json.dumps(request).encode() + b"\n")
    except OSError as error:
        raise NoOwnerError(f"the owner of {port} closed the connection: {error.strerror}") from None


def _next(port: str, answers: BufferedReader) -> dict[str, Any]:
    try:
        answer = json.loads(answers.readline(MAX_ANSWER))
    except (OSError, ValueError, RecursionError):
        raise NoOwnerError(f"the owner of {port} closed the connection without an answer") from None
    if not isinstance(answer, dict) or not isinstance(answer.get("ok"), bool):
        raise NoOwnerError(f"the process that answers for {port} is not sweepctl")
    if not answer["ok"]:
        status = answer.get("exit_status")
        raise OwnerRejectedError(
            str(answer.get("error", "rejected")), status if isinstance(status, int) else 4
        )
    return answer
