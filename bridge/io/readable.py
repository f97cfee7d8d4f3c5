"""Wait for readable file descriptors with any number."""

from __future__ import annotations

import select

SELECTED = 1024
"""Lowest descriptor that ``select`` does not support (FD_SETSIZE of POSIX). ``poll`` supports all
descriptors, but no terminals on some versions of macOS. So ``poll`` is the second choice."""


def readable(wanted: list[int], timeout_s: float | None) -> list[int]:
    """Wait for descriptors; return those that are readable or closed by the peer.

    Args:
        wanted: Descriptors.
        timeout_s: Maximum wait, s; None: unlimited.

    Raises:
        OSError: a descriptor is invalid.
        ValueError: a descriptor is negative.

    """
    if max(wanted) < SELECTED:
        return select.select(wanted, [], [], timeout_s)[0]
    polled = select.poll()
    for fd in wanted:
        polled.register(fd, select.POLLIN)
    return [fd for fd, _ in polled.poll(None if timeout_s is None else timeout_s * 1e3)]
