"""Asking the process that owns a port, from another one."""

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
MAX_ANSWER = 1 << 20
CONNECT_S = 1.0
"""Time for which a connection is tried while the owner's queue of connections is full, s."""
_RETRY_S = 0.005


def ask(
    port: str, request: dict[str, Any], *, timeout_s: float = ANSWER_TIMEOUT_S
) -> dict[str, Any]:
    """Ask the owner of a port once; its answer.

    Raises:
        NoOwnerError: nobody listens for this port, or it hung up without an answer.
        OwnerRefusedError: it did not do it; the text says why.

    """
    with _connected(port, timeout_s) as (client, answers):
        _send(port, client, request)
        return _next(port, answers)


def watch(port: str, *, hz: float = 4.0) -> Iterator[dict[str, Any]]:
    """What the owner of a port knows of the robot, again and again until the owner ends.

    Raises:
        NoOwnerError: nobody listens for this port.
        OwnerRefusedError: it does not tell.

    """
    with _connected(port, ANSWER_TIMEOUT_S) as (client, answers):
        _send(port, client, {"do": "watch", "hz": hz})
        yield _next(port, answers)["status"]
        while True:
            try:
                answer = _next(port, answers)
            except NoOwnerError:
                return
            yield answer["status"]


def has_owner(port: str) -> bool:
    """Whether a process listens for requests about this port."""
    try:
        with _connected(port, 1.0):
            return True
    except NoOwnerError:
        return False


@contextmanager
def _connected(port: str, timeout_s: float) -> Iterator[tuple[socket.socket, BufferedReader]]:
    if not hasattr(socket, "AF_UNIX"):
        raise NoOwnerError(f"{port}: no Unix sockets here, so no other process can be asked")
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
    """Connect; a listener whose queue is full is tried again, for it accepts all the time."""
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
        raise NoOwnerError(f"the owner of {port} hung up: {error.strerror}") from None


def _next(port: str, answers: BufferedReader) -> dict[str, Any]:
    try:
        answer = json.loads(answers.readline(MAX_ANSWER))
    except (OSError, ValueError, RecursionError):
        raise NoOwnerError(f"the owner of {port} hung up without an answer") from None
    if not isinstance(answer, dict) or not isinstance(answer.get("ok"), bool):
        raise NoOwnerError(f"what answers for {port} is no sweepctl")
    if not answer["ok"]:
        status = answer.get("exit_status")
        raise OwnerRejectedError(
            str(answer.get("error", "refused")), status if isinstance(status, int) else 4
        )
    return answer
