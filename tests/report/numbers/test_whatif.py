"""Flights re-weighted to other dispersions say what a fresh campaign on those dispersions finds."""

import json

import numpy as np
import pytest
from fake_flight import run, write_campaign
from programs import invoke

from abhv_mc.analysis.reweight import parse_settings
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.messages import InputError
from abhv_mc.report.numbers.report_numbers import make_numbers
from abhv_mc.report.numbers.whatif import estimate_controller, make_whatif
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.topics.topic import Models

LAWS = (
    "{atmosphere.density: {distribution: uniform, half_width: %s}, aero.lift: {distribution: "
    "normal, sigma: %s}}"
)


def fly(folder, density="10 %", lift="5 %", seed="5"):
    files = write_campaign(
        folder / "f",
        seed=seed,
        runs="1500",
        requirements="[{metric: altitude_error_max_m, below: 1.85, probability: 0.9}]",
        dispersions=LAWS % (density, lift),
        keep="{histories: {flights: none}, envelopes: {channels: [altitude_m], rate: 5 Hz}}",
    )
    return run(files, folder / "out").folder


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("whatif"))


def agree(reweighted, fresh_folder):
    """Assert that each interval of a fresh campaign overlaps that of the re-weighted flights."""
    numbers = make_numbers(Models(read_flown(fresh_folder)))
    for name, controller in reweighted.controllers.items():
        estimates = {(row.metric, row.level): row for row in controller.estimates}
        for metric in ("altitude_error_max_m", "speed_error_max_mps", "fuel_used_kg"):
            fresh = numbers["metrics"]["table"][metric]["controllers"][name]["quantiles"]
            for level in ("q50", "q95"):
                after, interval = estimates[metric, level].after, fresh[level]
                assert after.low <= interval["high"] and interval["low"] <= after.high, metric
            assert after != estimates[metric, "q95"].before
        share = estimates["altitude_error_max_m", "share"].after
        verdict = numbers["verdicts"]["requirements"][0]["controllers"][name]
        low, high = clopper_pearson(verdict["failures"], verdict["flights"])
        assert share.low <= high and low <= share.high


def test_it_agrees_with_a_fresh_campaign(flown, tmp_path):
    reweighted = make_whatif(
        flown, parse_settings(["atmosphere.density.half_width=6%", "aero.lift.sigma=4 %"])
    )
    agree(reweighted, fly(tmp_path, "6 %", "4 %", seed="77"))
    controller = reweighted.controllers["one"]
    assert 0.5 * 1500 < controller.effective_flights < 0.65 * 1500 and controller.unseen < 1e-3
    assert reweighted.after["atmosphere.density"] == {"distribution": "uniform", "half_width": "6%"}


def test_upper_bounds_include_what_no_flight_represents(flown):
    results = read_flown(flown)
    weights = np.ones(results.flights["one"].flight.size)
    plain, wide = (
        [
            row.after.high
            for row in estimate_controller(results, "one", weights, unseen)
            if row.metric == "altitude_error_max_m"
        ]
        for unseen in (0.0, 0.04)
    )
    assert wide[0] > plain[0] and wide[-1] == pytest.approx(plain[-1] + 0.04)


@pytest.mark.parametrize(("settings", "message"), [
    (["atmosphere.density.half_width=12%"], r" 0\.9\b"),
    (["atmosphere.density.half_width=0.4%"], r"\b750\b"),
    (["aero.lift.sigma=9%"], r"\b1500\b.*\b1 %"),
    (["aero.lift=9%"], r"aero\.lift\.sigma=VALUE"),
    (["aero.drag.sigma=5%"], r"'aero\.drag'"),
    (["aero.lift.distribution=discrete", "aero.lift.values=[0.9, 1.1]"],
        r"\bkind\b"),
])  # fmt: skip
def test_what_the_flights_do_not_say_is_refused(flown, settings, message):
    with pytest.raises(InputError, match=message):
        make_whatif(flown, parse_settings(settings))


def test_the_command(flown):
    arguments = ["tighten", flown, "aero.lift.sigma=4%"]
    result = invoke(*arguments)
    assert result.exit_code == 0 and "Altitude error, max < 1.85" in result.stdout
    assert "aero.lift: distribution normal, sigma 4%" in result.stdout
    assert isinstance(invoke(*arguments, "-o", "x").exception, InputError)
    numbers = json.loads(invoke(*arguments, "--json", "-").stdout)
    assert numbers["controllers"].keys() == {"one", "two"}
