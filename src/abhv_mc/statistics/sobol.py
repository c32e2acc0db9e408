"""Sobol indices: which share of an output's variance each independent input causes, alone and with all others.

SALib's estimators (Saltelli et al., Computer Physics Communications 181, 2010) on the flights of a Saltelli design,
with intervals from resampled groups of flights.
"""

from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.statistics.estimates import SEED

RESAMPLES = 300
FEWEST_GROUPS = 16


@dataclass(frozen=True)
class SobolIndices:
    """Indices [input, output] with the ends of their intervals; NaN for a constant output."""

    first: Floats  # share that the input causes alone
    first_low: Floats
    first_high: Floats
    total: Floats  # share that involves the input
    total_low: Floats
    total_high: Floats


def sobol_indices(outputs: Floats, inputs: int, confidence: float = 0.95) -> SobolIndices:
    """Indices of `outputs` [flight, output], the flights in groups of `inputs` + 2: A, A with one column of B each, B.

    Raises ValueError for outputs that are not finite, or for groups that are too few or not whole.
    """
    group = inputs + 2
    if outputs.shape[0] % group or outputs.shape[0] < FEWEST_GROUPS * group:
        expected = f"at least {FEWEST_GROUPS} whole groups of {group}"
        raise ValueError(f"{outputs.shape[0]} flights instead of {expected}")
    if not np.isfinite(outputs).all():
        raise ValueError("outputs that are not finite have no variance to share out")
    from SALib.analyze import sobol

    problem = {"num_vars": inputs, "names": [str(i) for i in range(inputs)], "bounds": [[0.0, 1.0]] * inputs}
    table = np.full((4, inputs, outputs.shape[1]), np.nan)
    for column, values in enumerate(outputs.T):
        if np.ptp(values) <= 1e-12 * np.abs(values).max():
            continue
        found = sobol.analyze(
            problem, values, calc_second_order=False, num_resamples=RESAMPLES, conf_level=confidence, seed=SEED
        )
        table[:, :, column] = found["S1"], found["S1_conf"], found["ST"], found["ST_conf"]
    first, first_half, total, total_half = table
    return SobolIndices(
        first, first - first_half, first + first_half, total, np.maximum(total - total_half, 0.0), total + total_half
    )
