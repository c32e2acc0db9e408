"""Type aliases of numpy arrays."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Indices = NDArray[np.intp]
Singles = NDArray[np.float32]
Numbers = NDArray[Any]  # float64, or complex128 for complex-step derivatives
Complexes = NDArray[np.complex128]
Mask = NDArray[np.bool_]
