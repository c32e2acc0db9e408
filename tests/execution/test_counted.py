"""Blocks that come back counted: the same envelopes as of samples, whoever flies them and whatever gets lost."""

import numpy as np
from fake_flight import fly, make_plan

from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.execution.blocks import choose_counted
from abhv_mc.execution.fly_batches import fly_counted
from abhv_mc.execution.retry import FlightLostError, fly_with_retries
from abhv_mc.execution.worker_processes import WorkerPool
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import Recording
from abhv_mc.folder.counted import Counting
from abhv_mc.folder.histogram import Histograms, make_bins

PLAN = make_plan("one")
ROWS = full_rows(("atmosphere.density",), np.random.default_rng(1).uniform(0.9, 1.1, (500, 1)))
RECORDING = Recording(4, (3, 11, 0), extremes=True)
WHOLE = fly(PLAN, ROWS, RECORDING)
BINS = make_bins(WHOLE.history[:128].reshape(128, -1))
COUNTING = Counting(RECORDING, *BINS, batch=64)


def assert_counted(block, missing=0):
    kept = block.outcome != Outcome.FAILED_TO_RUN
    assert len(kept) == len(ROWS) and (~kept).sum() == missing
    expected = Histograms(*BINS)
    expected.add(WHOLE.history[kept].reshape(kept.sum(), -1))
    np.testing.assert_array_equal(block.counts, expected.counts)
    np.testing.assert_array_equal(block.ends, expected.tails())
    np.testing.assert_array_equal(block.metrics[kept], WHOLE.metrics[kept])
    assert block.history.size == 0


def test_a_counted_block_is_the_sum_of_its_flights():
    block = fly_counted(fly, PLAN, ROWS, COUNTING)
    assert_counted(block)
    np.testing.assert_array_equal(block.low, WHOLE.low)
    np.testing.assert_array_equal(block.high, WHOLE.high)


def test_worker_processes_count():
    pool = WorkerPool(fly, 1, 60.0)
    try:
        assert_counted(pool.fly(PLAN, ROWS, COUNTING))
    finally:
        pool.close()


def test_a_block_that_is_lost_is_flown_in_parts_and_counted_here():
    """A flight that ends its process costs the others nothing."""

    def attempt(rows, recorded):
        if (rows[:, 0:] == ROWS[77]).all(axis=1).any():
            raise FlightLostError("its process ended")
        return fly_counted(fly, PLAN, rows, recorded) if isinstance(recorded, Counting) else fly(PLAN, rows, recorded)

    assert_counted(fly_with_retries(attempt, PLAN, ROWS, COUNTING), missing=1)


def test_blocks_are_whole_batches_and_enough_for_all_workers():
    assert choose_counted(10_000_000, 64, 256) == 8192
    assert choose_counted(10_000, 2, 256) == 1024 + 256 - 256
    assert choose_counted(5000, 64, 256) == 256
