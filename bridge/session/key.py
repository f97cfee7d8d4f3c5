"""The key with which a session signs commands, and the state of its challenge."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.authentication import Authenticator
from protocol.messages.values import Capability

if TYPE_CHECKING:
    from protocol.link import LinkBase
    from protocol.messages.device import Challenge, Hello


class SessionKey:
    """Sets up and revokes the signing key of a session's link."""

    def __init__(self, link: LinkBase, key: bytes | None) -> None:
        """Sign with ``key``; None: sign nothing.

        Raises:
            BadKeyError: the key is not 16 bytes long.

        """
        self._link = link
        self.use(key)

    def use(self, key: bytes | None) -> None:
        """Sign with this key after the device's next challenge; None: sign nothing."""
        self._link.key = None if key is None else Authenticator(key)

    def end(self) -> None:
        """Stop signing until the next session's challenge."""
        if self._link.key is not None:
            self._link.key.end()

    def take(self, challenge: Challenge, hello: Hello | None, session_id: int) -> None:
        """Use a challenge if the device's last hello contained this session's id."""
        key = self._link.key
        if key is not None and hello is not None and hello.session_id == session_id:
            key.begin(hello.boot_id, session_id, challenge.counter)

    def allows(self, hello: Hello | None) -> bool:
        """Return False if the device requires signatures and its challenge is missing."""
        key = self._link.key
        asks = hello is not None and bool((hello.capabilities or 0) & Capability.AUTHENTICATION)
        return key is None or key.begun or not asks
