"""No flight leaves the band of all flights, at no control tick."""

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, TICKS, fly, make_plan, write_campaign

from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.execution import every_tick
from abhv_mc.execution.every_tick import fly_every_tick
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.folder import envelope_states as collector


@pytest.fixture(autouse=True)
def quiet(capfd):
    """Progress goes to standard error."""


def drawn(count):
    density = np.random.default_rng(1).uniform(0.9, 1.1, count)
    return full_rows(("atmosphere.density",), density[:, None])


@pytest.mark.parametrize("values", [24_000_000, 1])
def test_samples_are_those_of_a_flight_recorded_so(values, monkeypatch):
    monkeypatch.setattr(every_tick, "_MOST_VALUES", values)
    plan, rows = make_plan("one"), drawn(100)
    found, plain = fly_every_tick(fly, plan, rows, 4), fly(plan, rows, 4)
    for name in ("outcome", "end_time", "metrics", "history", "times"):
        np.testing.assert_array_equal(getattr(found, name), getattr(plain, name))
    whole = fly(plan, rows, 1).history
    for k in range(6):
        around = whole[:, max(0, 4 * (k - 1)) : 4 * (k + 1) + 1]
        np.testing.assert_array_equal(found.low[k], np.nanmin(around, axis=(0, 1)))
        np.testing.assert_array_equal(found.high[k], np.nanmax(around, axis=(0, 1)))


@pytest.mark.parametrize("exact", [4096, 0])
def test_no_flight_leaves_the_band_between_two_samples(tmp_path, exact, monkeypatch):
    monkeypatch.setattr(collector, "EXACT_FLIGHTS", exact)
    out = tmp_path / "out"
    run_campaign(Request(write_campaign(tmp_path / "f"), out), ENGINE)
    samples = pq.read_table(out / "samples.parquet")
    values = np.column_stack([samples[name].to_numpy() for name in samples.column_names[1:]])
    block = fly(make_plan("one"), full_rows(samples.column_names[1:], values), 1)
    history = block.history[:, :, CHANNEL_INDEX["bank_deg"]].astype(np.float64)
    table = pq.read_table(out / "envelopes.parquet", filters=[("controller", "=", "one"), ("channel", "=", "bank_deg")])
    time, low, high = (table[name].to_numpy() for name in ("time", "min", "max"))
    ticks = np.arange(TICKS + 1) * 0.1
    assert not np.any(history < np.interp(ticks, time, low) - 1e-6)  # what has ended is not-a-number
    assert not np.any(history > np.interp(ticks, time, high) + 1e-6)
