"""The estimate before flying, against what the same campaign then takes."""

from dataclasses import replace

import pytest
from fake_flight import ENGINE, SLOW_ENGINE, run, write_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.estimate import estimate_campaign


def test_disk_is_what_the_campaign_takes(tmp_path, capfd):
    campaign = write_campaign(tmp_path / "files", execution="{workers: 2, batch: 60}")
    cost = estimate_campaign(read_campaign(campaign), ENGINE)
    run(campaign, tmp_path / "out")
    rows = sum(path.stat().st_size for path in (tmp_path / "out/flights").iterdir())
    assert cost.rows_bytes == pytest.approx(rows, rel=0.2)
    assert (cost.flights, cost.controllers, cost.workers, cost.batch, cost.kept) == (300, 2, 2, 60, 6)


def test_time_follows_the_flights(tmp_path):
    campaign = read_campaign(write_campaign(tmp_path / "files"))
    cost = estimate_campaign(campaign, SLOW_ENGINE, workers=4)
    assert cost.flight_s > 0.02 / 64  # the slow flight sleeps that long for its 64 trials
    assert cost.flying_s == pytest.approx(2 * cost.flight_s * (300 + 6) / 4)
    large = replace(campaign, runs=1_000_000)
    assert estimate_campaign(large, ENGINE).envelope_bytes < 50e6  # flat
