"""Back-off: the growing interval between attempts to reach a lost device or port."""

from __future__ import annotations

_BACKOFF_NS = (250_000_000, 500_000_000, 1_000_000_000, 2_000_000_000)


def backoff_ns(tries: int) -> int:
    """Return the interval before the next attempt to reach a lost device or port, ns.

    ``tries`` is the number of attempts so far. The longest interval repeats.
    """
    return _BACKOFF_NS[min(tries, len(_BACKOFF_NS) - 1)]
