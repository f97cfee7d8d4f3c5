"""A session's key: what the host signs with, and when it can."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.authentication import Authenticator
from protocol.values import Capability

if TYPE_CHECKING:
    from protocol.link import LinkBase
    from protocol.messages import Challenge, Hello


class SessionKey:
    """The key of the session's link; the link itself signs."""

    def __init__(self, link: LinkBase, key: bytes | None) -> None:
        """Know a key, or none.

        Raises:
            BadKeyError: it has not 16 bytes.

        """
        self._link = link
        self.use(key)

    def use(self, key: bytes | None) -> None:
        """Sign with this key from the device's next challenge on; None: sign nothing."""
        self._link.key = None if key is None else Authenticator(key)

    def end(self) -> None:
        """Another session begins: nothing is signed before its challenge has come."""
        if self._link.key is not None:
            self._link.key.end()

    def take(self, challenge: Challenge, hello: Hello | None, session_id: int) -> None:
        """The device's challenge; it is this session's where its last hello named this one."""
        key = self._link.key
        if key is not None and hello is not None and hello.session_id == session_id:
            key.begin(hello.boot_id, session_id, challenge.counter)

    def allows(self, hello: Hello | None) -> bool:
        """False while the device asks for tags, and we have a key but no challenge yet."""
        key = self._link.key
        asks = hello is not None and bool((hello.capabilities or 0) & Capability.AUTHENTICATION)
        return key is None or key.begun or not asks
