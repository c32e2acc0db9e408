"""Types of arrays, once for every layer."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Singles = NDArray[np.float32]
Complexes = NDArray[np.complex128]
Mask = NDArray[np.bool_]
