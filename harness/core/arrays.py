"""What arrays hold, by name: the aliases that annotations use; and the box around points."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Double precision, the default for geometry.
Floats = NDArray[np.float64]
#: Single precision, for pictures and networks.
Singles = NDArray[np.float32]
#: Indices and counts.
Ints = NDArray[np.int64]
#: Indices and counts where memory matters.
Ints32 = NDArray[np.int32]
#: Integers of any size, as files give them.
AnyInts = NDArray[np.integer[Any]]
#: True where something holds.
Mask = NDArray[np.bool_]
#: Colours of eight bits a channel.
Bytes = NDArray[np.uint8]


def box_of(points: Floats) -> Floats:
    """(2, D) lower and upper corner of the box around (N, D) points.

    By component, which is several times as fast as along the short rows.
    """
    return np.array([[axis.min() for axis in points.T], [axis.max() for axis in points.T]])
