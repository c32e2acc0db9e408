"""No flight leaves the band of all flights, at no control tick."""

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, TICKS, fly, make_plan, write_campaign

from abhv_mc.campaign.sampling.samples import full_rows
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.folder import envelope_states as collector


@pytest.fixture(autouse=True)
def quiet(capfd):
    """Progress goes to standard error."""


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
