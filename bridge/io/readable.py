"""Wait for readable descriptors of any number."""

from __future__ import annotations

import select

SELECTED = 1024
"""Lowest descriptor that ``select`` does not support: POSIX's FD_SETSIZE. ``poll`` supports it, but
not for terminals on some versions of macOS, so it is the second choice."""


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
