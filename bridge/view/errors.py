"""Errors of the viewers."""

from __future__ import annotations

from bridge.errors import BridgeError


class ViewerMissingError(BridgeError):
    """Rerun is not installed."""

    def __init__(self) -> None:
        super().__init__("the viewer is not installed: pip install 'sweepctl[view]'")


class NoDisplayError(BridgeError):
    """A window was requested without a display."""

    def __init__(self, more: str = "") -> None:
        """Create the error; ``more`` is added to the message and lists alternatives."""
        super().__init__(
            f"there is no display for a window; --serve shows it in a browser on this machine{more}"
        )


class ViewerFailedError(BridgeError):
    """The viewer did not start, or crashed, for example without a graphics driver."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(f"the viewer ended with status {status}: {reason}")
        self.status = status


class FoxgloveMissingError(BridgeError):
    """foxglove-sdk is not installed."""

    def __init__(self) -> None:
        super().__init__(
            "the live server for Foxglove is not installed: pip install 'sweepctl[foxglove]'"
        )


class FoxgloveServerError(BridgeError):
    """The live server for Foxglove cannot listen on its address."""

    def __init__(self, host: str, port: int, reason: str) -> None:
        super().__init__(f"cannot serve Foxglove on {host}:{port}: {reason}")
