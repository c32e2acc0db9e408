"""Blocks of flights whose histories are sampled, with the extremes between the samples from every control tick.

The bands of an envelope are drawn from sample to sample. So that no flight leaves them, the extremes at a sample are
those of all ticks from the sample before it to the one after it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.execution.blocks import Fly
from abhv_mc.flight.channels import CHANNELS
from abhv_mc.flight.plan import LANES, FlightBlock, FlightPlan

_MOST_VALUES = 24_000_000  # of the whole histories that one call holds: 96 MB

Singles = NDArray[np.float32]


@dataclass(frozen=True)
class BinnedBlock(FlightBlock):
    """A block with the extremes of its flights around each recorded time."""

    low: Singles | None = None  # [time, channel] NaN where no flight was flying
    high: Singles | None = None


def fly_every_tick(fly: Fly, plan: FlightPlan, parameters: NDArray[np.float64], every: int | None) -> FlightBlock:
    """What ``fly`` gives with samples ``every`` ticks apart, and extremes from all ticks; None: no history."""
    if every is None:
        return fly(plan, parameters, None)
    values = (plan.timing.ticks + 1) * len(CHANNELS)
    piece = max(1, _MOST_VALUES // (values * LANES)) * LANES
    blocks = [
        _bin_block(fly(plan, parameters[first : first + piece], 1), every)
        for first in range(0, max(1, len(parameters)), piece)
    ]
    return blocks[0] if len(blocks) == 1 else join_binned(blocks)


def _bin_block(block: FlightBlock, every: int) -> BinnedBlock:
    ends = [np.full(block.history.shape[1:], np.nan, np.float32) for _ in range(2)]
    if len(block.history):
        ends = [np.fmin.reduce(block.history, axis=0), np.fmax.reduce(block.history, axis=0)]
    low, high = (_around(end, every, which) for end, which in zip(ends, (np.fmin, np.fmax), strict=True))
    sampled = np.ascontiguousarray(block.history[:, ::every])
    return BinnedBlock(block.outcome, block.end_time, block.metrics, sampled, block.times[::every], low=low, high=high)


def _around(values: Singles, every: int, extreme: np.ufunc) -> Singles:
    """Extremes ``[sample, channel]`` of ``values[tick, channel]`` from the sample before to the one after each."""
    samples = (len(values) - 1) // every + 1
    starts = np.arange(samples) * every
    after = extreme.reduceat(values, starts, axis=0)  # from each sample up to the tick before the next
    found = after.copy()
    found[:-1] = extreme(after[:-1], values[starts[1:]])
    found[1:] = extreme(found[1:], after[:-1])
    return np.asarray(found, np.float32)


def join_binned(blocks: Sequence[FlightBlock]) -> BinnedBlock:
    """Blocks one after another as one. A flight that could not be computed has no extremes."""
    lows = [block.low for block in blocks if isinstance(block, BinnedBlock) and block.low is not None]
    highs = [block.high for block in blocks if isinstance(block, BinnedBlock) and block.high is not None]
    parts = {
        name: np.concatenate([getattr(block, name) for block in blocks])
        for name in ("outcome", "end_time", "metrics", "history")
    }
    low, high = (extreme.reduce(ends) if ends else None for extreme, ends in ((np.fmin, lows), (np.fmax, highs)))
    return BinnedBlock(**parts, times=blocks[0].times, low=low, high=high)
