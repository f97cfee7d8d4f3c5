"""Queue of the frames that wait for transmission. A newer cyclic message replaces a queued one."""

from __future__ import annotations

WaitingFrame = tuple[int, int, int, bytes, int, int]
"""A frame to send: node, type, stamp, payload, flags, rank. The sequence number is added at
transmission; otherwise a replaced frame would look like a lost frame. A plain tuple is used for
speed, because every sent message needs a new object."""


class SendQueue:
    """The frames that wait for transmission, in the order in which they were queued."""

    def __init__(self) -> None:
        self.frames: list[WaitingFrame] = []

    def add(self, frame: WaitingFrame) -> None:
        """Queue a frame behind all others."""
        self.frames.append(frame)

    def supersede(self, node: int, type_id: int) -> int:
        """Remove the queued frames that a newer one replaces; return their number.

        Cyclic messages must not accumulate, so a newer setpoint replaces a queued setpoint. The
        newer frame is queued behind all others.
        """
        kept = [frame for frame in self.frames if frame[1] != type_id or frame[0] != node]
        replaced = len(self.frames) - len(kept)
        self.frames = kept
        return replaced

    def take(self) -> list[WaitingFrame]:
        """Return and remove all frames."""
        frames = self.frames
        self.frames = []
        return frames
