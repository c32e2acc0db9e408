"""Arrays of plans."""

import types

import numpy as np

from abhv_mc.array_types import Ints
from abhv_mc_vehicle.flight.plan_arrays import find_dtype


def test_element_types_of_annotations_before_and_after_numpy_2_5():
    """From numpy 2.5 on (Python 3.12), NDArray[...] has the scalar as its only argument."""
    assert find_dtype(Ints) == np.int64
    assert find_dtype(types.GenericAlias(np.ndarray, (np.float64,))) == np.float64
