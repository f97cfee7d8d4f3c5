"""The arrays of ``bridge/motion/arrays.pxd``; what numpy knows of them is their dtype."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
FloatGrid: TypeAlias = NDArray[np.float64]
FloatBlock: TypeAlias = NDArray[np.float64]
Singles: TypeAlias = NDArray[np.float32]
Ints: TypeAlias = NDArray[np.int32]
IntGrid: TypeAlias = NDArray[np.int32]
Longs: TypeAlias = NDArray[np.int64]
LongGrid: TypeAlias = NDArray[np.int64]
LongBlock: TypeAlias = NDArray[np.int64]
Bytes: TypeAlias = NDArray[np.uint8]
ConstBytes: TypeAlias = NDArray[np.uint8]
Layer: TypeAlias = NDArray[np.uint8]
Pair: TypeAlias = tuple[float, float]
Four: TypeAlias = tuple[float, float, float, float]
