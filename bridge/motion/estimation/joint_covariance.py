"""A Gaussian belief over the robot's states and the walls it remembers: covariance algebra only.

The joint covariance keeps what the walls and the robot have in common: a wall first seen from
a doubtful pose shares that doubt, so that seeing it again takes away only what came since.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


class JointCovariance:
    """A covariance whose first states move and whose later ones stand still.

    The means belong to the caller; every update returns what to add to all of them.
    """

    __slots__ = ("_moving", "p")

    def __init__(self, variances: Sequence[float]) -> None:
        """Begin with the moving states, uncorrelated."""
        self._moving = len(variances)
        self.p: Floats = np.diag(np.asarray(variances, dtype=np.float64))
        """Covariance, ``(states, states)``."""

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.p)

    def propagate(self, transition: Floats, noise: Floats) -> None:
        """Move the moving states: F P Fᵀ + Q, both of shape ``(moving, moving)``."""
        n, p = self._moving, self.p
        top = transition @ p[:n]
        top[:, :n] = top[:, :n] @ transition.T + noise
        p[:n] = top
        p[n:, :n] = top[:, n:].T

    def project(self, index: Sequence[int], rows: Floats) -> tuple[Floats, Floats]:
        """P Hᵀ and H P Hᵀ for rows given by their columns that are not zero.

        Args:
            index: those columns, the same for each row.
            rows: ``(measurements, len(index))``.

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
        """Take a measurement (measured less predicted, its covariance); what to add to the means.

        States in ``held`` count with their doubt and are not changed (Schmidt's filter): for a
        measurement that is wrong in a way which would pass for them.

        Raises:
            numpy.linalg.LinAlgError: the innovation's covariance is singular.

        """
        ph, s = self.project(index, rows)
        gain = np.linalg.solve(s + noise, ph.T).T
        block = np.ix_(held, held) if held else None
        kept = self.p[block] if block else None
        self.p -= gain @ ph.T
        # Rounding makes it lopsided in the long run, and small negative variances with it.
        self.p += self.p.T
        self.p *= 0.5
        step: Floats = gain @ innovation
        if block:
            self.p[block] = kept
            step[list(held)] = 0.0
        return step

    def update_one(self, index: int, innovation: float, variance: float) -> Floats:
        """Take a measurement of one state alone."""
        column = self.p[:, index].copy()
        gain = column / (column[index] + variance)
        self.p -= np.outer(gain, column)
        step: Floats = gain * innovation
        return step

    def append(self, index: Sequence[int], rows: Floats, noise: Floats) -> int:
        """Add standing states that are ``rows`` of known ones and an error; their first place."""
        ph, s = self.project(index, rows)
        first = self.size
        grown = np.empty((first + len(rows), first + len(rows)))
        grown[:first, :first] = self.p
        grown[:first, first:] = ph
        grown[first:, :first] = ph.T
        grown[first:, first:] = s + noise
        self.p = grown
        return first

    def remove(self, first: int, count: int) -> None:
        """Forget standing states."""
        keep = [i for i in range(self.size) if not first <= i < first + count]
        self.p = self.p[np.ix_(keep, keep)].copy()

    def forget(self, index: Sequence[int], variances: Sequence[float]) -> None:
        """Set states to known variances with nothing in common with the others."""
        for i, variance in zip(index, variances, strict=True):
            self.p[i, :] = 0.0
            self.p[:, i] = 0.0
            self.p[i, i] = variance
