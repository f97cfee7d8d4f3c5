"""Waiting for descriptors, whatever their numbers."""

from __future__ import annotations

import select

SELECTED = 1024
"""Lowest descriptor that ``select`` cannot wait for, POSIX's FD_SETSIZE. ``poll`` can, and cannot
wait for a terminal on every version of macOS: so it is the second choice."""


def readable(wanted: list[int], timeout_s: float | None) -> list[int]:
    """Wait for descriptors; gives those that have something to read, or are gone.

    None: wait without an end.

    Raises:
        OSError: one of them is none.
        ValueError: one is negative.

    """
    if max(wanted) < SELECTED:
        return select.select(wanted, [], [], timeout_s)[0]
    polled = select.poll()
    for fd in wanted:
        polled.register(fd, select.POLLIN)
    return [fd for fd, _ in polled.poll(None if timeout_s is None else timeout_s * 1e3)]
