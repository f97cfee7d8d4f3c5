"""What can go wrong when a run is to be seen."""

from __future__ import annotations

from bridge.errors import BridgeError


class ViewerMissingError(BridgeError):
    """Rerun is not installed."""

    def __init__(self) -> None:
        super().__init__("the viewer is not installed: pip install 'sweepctl[view]'")


class NoDisplayError(BridgeError):
    """A window was asked for where there is none to be had."""

    def __init__(self, more: str = "") -> None:
        """``more``: what else the command can do, for the end of the line."""
        super().__init__(
            f"no display to open a window on: --serve shows it in a browser on this machine{more}"
        )


class ViewerFailedError(BridgeError):
    """The viewer did not start, or crashed: no graphics driver, its port taken."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(f"the viewer ended with status {status}: {reason}")
        self.status = status
