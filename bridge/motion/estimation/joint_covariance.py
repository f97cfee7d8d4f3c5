"""The covariance of a Kalman filter with landmarks. This module has only the algebra.

Robot and landmarks have one common covariance. The estimate of a new wall is correlated with the
robot's uncertain pose at that time. So a later measurement of the wall removes only the uncertainty
that was added since then.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


class JointCovariance:
    """A covariance of moving states, followed by static states (the landmarks).

    The caller owns the mean. Each update returns the step that the caller adds to the mean.
    """

    __slots__ = ("_moving", "p")

    def __init__(self, variances: Sequence[float]) -> None:
        """Begin with the variances of the uncorrelated moving states."""
        self._moving = len(variances)
        self.p: Floats = np.diag(np.asarray(variances, dtype=np.float64))
        """Covariance, ``(states, states)``."""

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.p)

    def propagate(self, transition: Floats, noise: Floats) -> None:
        """Predict the moving states: P ← F P Fᵀ + Q. F and Q are ``(moving, moving)``."""
        n, p = self._moving, self.p
        top = transition @ p[:n]
        top[:, :n] = top[:, :n] @ transition.T + noise
        p[:n] = top
        p[n:, :n] = top[:, n:].T

    def project(self, index: Sequence[int], rows: Floats) -> tuple[Floats, Floats]:
        """Return P Hᵀ and H P Hᵀ for a sparse matrix H.

        Args:
            index: columns of H that are not zero. They are equal for all rows.
            rows: values of these columns, ``(measurements, len(index))``.

        """
        columns = list(index)
        ph = self.p[:, columns] @ rows.T
        return ph, rows @ ph[columns]

    def update(
        self,
        index: Sequence[int],
        rows: Floats,
        innovation: Floats,
        noise: Floats,
        held: Sequence[int] = (),
    ) -> Floats:
        """Update with a measurement, and return the step of the mean.

        Args:
            index: Columns of H that are not zero.
            rows: Values of these columns, ``(measurements, len(index))``.
            innovation: Measured value minus predicted value, ``(measurements,)``.
            noise: Covariance of the measurement, ``(measurements, measurements)``.
            held: States that do not change, although their variance is used (Schmidt's filter). Use
                it if a measurement error could be mistaken for an error of these states.

        Raises:
            numpy.linalg.LinAlgError: the innovation's covariance is singular.

        """
        ph, s = self.project(index, rows)
        gain = np.linalg.solve(s + noise, ph.T).T
        block = np.ix_(held, held) if held else None
        kept = self.p[block] if block else None
        self.p -= gain @ ph.T
        # Rounding errors make the matrix asymmetric, and that would cause negative variances.
        self.p += self.p.T
        self.p *= 0.5
        step: Floats = gain @ innovation
        if block:
            self.p[block] = kept
            step[list(held)] = 0.0
        return step

    def update_one(self, index: int, innovation: float, variance: float) -> Floats:
        """Update with a measurement of one state, and return the step of the mean."""
        column = self.p[:, index].copy()
        gain = column / (column[index] + variance)
        self.p -= np.outer(gain, column)
        step: Floats = gain * innovation
        return step

    def augment(self, index: Sequence[int], rows: Floats, noise: Floats) -> int:
        """Add landmarks: ``rows`` of known states plus noise.

        Return the index of the first landmark.
        """
        ph, s = self.project(index, rows)
        first = self.size
        grown = np.empty((first + len(rows), first + len(rows)))
        grown[:first, :first] = self.p
        grown[:first, first:] = ph
        grown[first:, :first] = ph.T
        grown[first:, first:] = s + noise
        self.p = grown
        return first

    def marginalise(self, first: int, count: int) -> None:
        """Remove ``count`` states of landmarks, starting at index ``first``."""
        keep = [i for i in range(self.size) if not first <= i < first + count]
        self.p = self.p[np.ix_(keep, keep)].copy()

    def reset(self, index: Sequence[int], variances: Sequence[float]) -> None:
        """Set states to these variances and remove their correlation with all other states."""
        for i, variance in zip(index, variances, strict=True):
            self.p[i, :] = 0.0
            self.p[:, i] = 0.0
            self.p[i, i] = variance
