"""Velocity smoothing: a low-pass, then an acceleration limit (paper section 3.3, part 5)."""

from __future__ import annotations


class VelocitySmoother:
    """First-order low-pass and acceleration limit for one velocity.

    The paper's low-pass combines v(t-1) and v(t) of its *input*. This smooths almost nothing, but
    the paper's Fig. 11 shows an exponential filter. So this filter uses its own previous output:
    y(t) = (1 - k) y(t-1) + k v(t). The acceleration limit is applied to the difference from the
    *last output*, so it limits the velocity that is sent.
    """

    __slots__ = ("_k", "_limit", "_output")

    def __init__(self, max_accel: float, lowpass: float = 0.5) -> None:
        """Create a filter.

        ``max_accel`` is per s²; ``lowpass`` is the paper's factor k in (0, 1] for each call,
        independent of ``dt_s``.
        """
        if not 0.0 < lowpass <= 1.0:
            raise ValueError(f"low-pass factor must be in (0, 1], not {lowpass!r}")
        if not max_accel > 0.0:
            raise ValueError(f"maximum acceleration must be positive, not {max_accel!r}")
        self._k = lowpass
        self._limit = max_accel
        self._output = 0.0

    @property
    def output(self) -> float:
        """Last output."""
        return self._output

    def reset(self, output: float = 0.0) -> None:
        """Set the last output, for example to zero after a halt without a ramp."""
        self._output = output

    def update(self, target: float, dt_s: float) -> float:
        """Return the velocity to send for a ``target``. If ``dt_s`` ≤ 0, return the last output."""
        if dt_s <= 0.0:
            return self._output
        step = self._k * (target - self._output)
        limit = self._limit * dt_s
        if step > limit:
            step = limit
        elif step < -limit:
            step = -limit
        self._output += step
        return self._output
