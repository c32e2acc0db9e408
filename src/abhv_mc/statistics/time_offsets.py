"""Offset in time between a record and simulated flights."""

import numpy as np

from abhv_mc.array_types import Floats

_SHIFTS = 41  # number of shifts that are tried
_SIGNIFICANT = 25.0  # smallest significant reduction of the sum of squares, in noise variances


def find_offset(simulated: Floats, record: Floats, span: float, modes: int) -> tuple[float, bool]:
    """Return the shift of `record` [time, channel] in samples, and whether it is significant.

    The shift minimizes the mean squared deviation from the mean of `simulated`
    [flight, time, channel] that the first principal `modes` of the simulated flights do not
    explain, so that dispersed parameters do not look like an offset. `span` is the largest shift as
    a share of the samples. A shift is significant if it reduces the deviation by more than for any
    simulated flight.
    """
    count = np.maximum(np.isfinite(simulated).sum(axis=0), 1)
    middle = np.nansum(simulated, axis=0) / count
    spread = np.sqrt(np.nansum((simulated - middle) ** 2, axis=0) / count)
    spread = np.maximum(spread, 0.05 * spread.max(axis=0) + np.finfo(float).tiny)
    flights = np.concatenate([simulated, record[np.newaxis]])
    deviations = np.nan_to_num((simulated - middle) / spread).reshape(len(simulated), -1)
    *_, directions = np.linalg.svd(deviations, full_matrices=False)
    directions = directions[:modes].reshape(-1, *record.shape)
    most = max(1, round(span * len(record)))
    shifts = np.unique(np.linspace(-most, most, _SHIFTS).astype(np.int64))
    losses = np.empty((len(shifts), len(flights)))
    for row, shift in enumerate(shifts.tolist()):
        own = slice(max(0, -shift), len(record) - max(0, shift))
        moved = flights[:, own.start + shift : own.stop + shift]
        valid = np.isfinite(moved[-1]) & np.isfinite(middle[own])
        values = np.nan_to_num((moved - middle[own]) / spread[own])[:, valid]
        basis, _ = np.linalg.qr(directions[:, own][:, valid].T)
        losses[row] = np.mean((values - values @ basis @ basis.T) ** 2, axis=1)
    gains = losses[len(shifts) // 2] - losses.min(axis=0)
    best = int(np.clip(losses[:, -1].argmin(), 1, len(shifts) - 2))
    left, middle_loss, right = losses[best - 1 : best + 2, -1]
    curvature = left - 2.0 * middle_loss + right
    steps = 0.5 * (left - right) / curvature if curvature > 0.0 else 0.0
    step = float(shifts[best + 1] - shifts[best - 1]) / 2.0
    offset = float(shifts[best] + np.clip(steps, -1.0, 1.0) * step)
    noise = _SIGNIFICANT / valid.sum() * losses[:, -1].min()
    return offset, bool(gains[-1] > max(noise, gains[:-1].max()))
