"""Checks before a run: estimate of its cost, and dispersions without effect."""

from dataclasses import replace

import numpy as np
import pytest
from fake_flight import ENGINE, SLOW_ENGINE, run, write_campaign
from own_simulators import write_study

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution import executor
from abhv_mc.execution.estimate import estimate_campaign
from abhv_mc.execution.first_flights import make_trials
from abhv_mc.io.messages import InputError

GUSTS = """{wind.gust_north: {distribution: normal, sigma: 5 m/s},
            wind.gust_start: {distribution: uniform, low: 5 s, high: 45 s}}"""


def test_the_estimated_disk_space_is_needed(tmp_path, capfd):
    campaign = write_campaign(tmp_path / "files", execution="{workers: 2, batch: 60}")
    cost = estimate_campaign(read_campaign(campaign), ENGINE)
    run(campaign, tmp_path / "out")
    rows, histories = (
        sum(path.stat().st_size for path in (tmp_path / "out" / name).iterdir())
        for name in ("flights", "histories")
    )
    assert cost.rows_bytes == pytest.approx(rows, rel=0.2)
    assert 0.1 < cost.histories_bytes / histories < 1.0  # a file holds few flights
    counts = cost.flights, cost.controllers, cost.workers, cost.batch, cost.kept
    assert counts == (300, 2, 2, 60, 6)


def test_the_estimated_time_follows_the_number_of_flights(tmp_path):
    campaign = read_campaign(write_campaign(tmp_path / "files"))
    cost = estimate_campaign(campaign, SLOW_ENGINE, workers=4)
    assert cost.flight_s > 0.02 / 64  # the slow flight sleeps 0.02 s per 64 trials
    assert cost.flying_s == pytest.approx(2 * cost.flight_s * (300 + 6) / 4)
    assert replace(cost, searched=80).search_s == pytest.approx(2 * cost.flight_s * 80 / 4)
    # 11 samples in 2 s, of 4 bytes, in 300 flights of 2 controllers
    assert cost.envelope_bytes == 4 * 11 * len(campaign.enveloped_channels) * 300 * 2
    large = replace(campaign, runs=1_000_000)
    assert estimate_campaign(large, ENGINE).envelope_bytes < 50e6  # does not grow with the flights


@pytest.mark.parametrize(("rate", "samples"), [("10 Hz", 21), ("2 Hz", 5)])
def test_envelopes_take_the_space_of_their_rate(tmp_path, rate, samples):
    keep = f"{{histories: {{flights: [7]}}, envelopes: {{rate: {rate}}}}}"
    campaign = read_campaign(write_campaign(tmp_path, keep=keep))
    cost = estimate_campaign(campaign, ENGINE)
    assert cost.envelope_bytes == 4 * samples * len(campaign.enveloped_channels) * 300 * 2
    assert cost.disk_bytes == cost.envelope_bytes + cost.rows_bytes + cost.histories_bytes


def test_the_search_over_unknowns_takes_time(tmp_path):
    entries = {"unknowns": "{aero.lift: {low: -10 %, high: 10 %}}", "keep": "{histories: {}}"}
    dispersions = "{atmosphere.density: {distribution: uniform, half_width: 10 %}}"
    campaign = read_campaign(write_campaign(tmp_path, dispersions=dispersions, **entries))
    cost = estimate_campaign(campaign, ENGINE, workers=3)
    assert cost.searched > campaign.runs_at_point
    flights = campaign.runs + cost.kept + cost.searched
    assert cost.flying_s == pytest.approx(2 * flights * cost.flight_s / 3)
    assert cost.search_s == pytest.approx(2 * cost.searched * cost.flight_s / 3)


def test_a_dispersion_without_effect_is_rejected(tmp_path):
    entry = (
        "{aero.lift: {distribution: normal, sigma: 5 %}, mass.total: {distribution: "
        "uniform, half_width: 5 %}}"
    )
    with pytest.raises(InputError, match=r":\d+:\d+: 'mass\.total' .*\b0\.95 .*\b1\.05 "):
        run(write_campaign(tmp_path / "files", dispersions=entry), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_start_of_a_symmetric_gust_has_an_effect(tmp_path):
    """The start of a gust has no effect if the gust is at its median, zero."""
    trials = make_trials(read_campaign(write_campaign(tmp_path, dispersions=GUSTS)))
    assert (trials[4:, 0] == trials[4, 0]).all()
    assert trials[4, 0] > 0.0
    assert np.array_equal(trials[5:, 1], [5.0, 45.0])


def test_envelopes_of_a_custom_simulator_take_the_space_of_their_samples(tmp_path, monkeypatch):
    """10 s of two channels of 4 bytes have 21 samples at 2 Hz, a quarter of them at 0.5 Hz."""
    flown = []

    def simulate(campaign, name, rows, *arguments):
        flown.append((name, len(rows)))
        return executor.simulate(campaign, name, rows, *arguments)

    monkeypatch.setattr("abhv_mc.execution.estimate.simulate", simulate)
    source = (
        "def fly(inputs, settings):\n    time = [0.5 * k for k in range(21)]\n"
        "    total = inputs['a'] + inputs['b']\n"
        "    history = {'time': time, 'x': [total] * 21, 'y': [-total] * 21}\n"
        "    return {'total': total, 'history': history}\n"
    )
    changes = {
        "systems": {name: {} for name in ("one", "two", "three")},
        "histories": {"x": {"unit": "m"}, "y": {"unit": "m"}},
        "keep": {
            "histories": {"flights": [1, 5, "every 10"], "rate": "2 Hz"},
            "envelopes": {"rate": "0.5 Hz"},
        },
    }
    cost = estimate_campaign(read_campaign(write_study(tmp_path, source, **changes)), workers=2)
    assert (cost.flights, cost.controllers, cost.kept, cost.searched) == (20, 3, 4, 0)
    assert cost.envelope_bytes == 4 * round(21 / 4) * 2 * 20 * 3
    assert flown == [(name, flights) for name in changes["systems"] for flights in (20, 16)]
    assert cost.histories_bytes % 4 == 0 and cost.histories_bytes > 4 * 3 * 21 * 2
