"""Detects by its colour each part of the viewer's picture; red, green and blue from 0 to 1."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Picture = NDArray[np.float32]
    Mask = NDArray[np.bool_]


def swept(picture: Picture) -> Mask:
    """Swept floor: green."""
    red, green, blue = (picture[..., channel] for channel in range(3))
    return (green > 0.45) & (red < 0.35) & (blue < 0.5)


def walls(picture: Picture) -> Mask:
    """Walls: white."""
    red, green, blue = (picture[..., channel] for channel in range(3))
    return (red > 0.9) & (green > 0.9) & (blue > 0.9)
