"""The key that authenticates motion: stored and used, but never sent."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.authentication import GUARDED_TYPES, Authenticator, key_of
from protocol.link import Medium
from protocol.messages.device import Challenge
from protocol.messages.values import NackReason
from protocol.uart.framing import FLAG_AUTHENTICATED

if TYPE_CHECKING:
    from protocol.link import LinkBase
    from protocol.messages.host import SetKey
    from protocol.uart.framing import Frame
    from sim_device.device.flash import Flash


class Keyring:
    """Use of the key in the flash during one boot."""

    def __init__(self, flash: Flash, link: LinkBase, boot_id: int, *, local: bool) -> None:
        """Use a link; ``local`` means that only a person beside the robot can use the link."""
        self._flash, self._link, self._boot_id = flash, link, boot_id
        self.may_set = local and link.medium is Medium.UART
        self._session_id = 0
        self._openings = 0
        self._counter = 0
        self.take()

    def take(self) -> None:
        """Load the key from the flash."""
        key = self._flash.key
        self._link.key = None if key is None else Authenticator(key)

    def open(self, session_id: int) -> None:
        """Begin a session; signed frames of other sessions are invalid."""
        self._session_id = session_id
        key = self._link.key
        if key is None:
            return
        self._openings += 1
        self._counter = key.challenge(self._boot_id, session_id, self._openings)
        key.begin(self._boot_id, session_id, self._counter)

    def close(self) -> None:
        """End the session; no signed frame is accepted."""
        if self._link.key is not None:
            self._link.key.end()

    def challenge(self) -> Challenge:
        """Return the message that a host needs to sign frames in this session."""
        return Challenge(self._counter)

    @staticmethod
    def must_reject(frame: Frame) -> bool:
        """Return whether a frame without a tag must be rejected; call only with a key set."""
        return frame.type_id in GUARDED_TYPES and not frame.version_flags & FLAG_AUTHENTICATED

    def change(self, command: SetKey) -> NackReason | None:
        """Set, replace or remove the key; return the reason of a rejection, or None."""
        if not self.may_set:
            return NackReason.UNSUPPORTED
        self._flash.key = key_of((command.key_0, command.key_1, command.key_2, command.key_3))
        self.take()
        self.open(self._session_id)
        return None
