"""Widths with which a controller passes, of campaigns whose probability of a PASS is known."""

import numpy as np
import pytest
from fake_flight import DRAG, interrupted_after, prepare, run
from programs import invoke
from scipy import stats
from search.known_flights import fly_line, write_line

from abhv_mc import open_results
from abhv_mc.analysis.reweight import make_change
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.interfaces import Engine
from abhv_mc.io.messages import InputError
from abhv_mc.search.tighten import narrow, tighten

LAWS = (
    "{aero.drag: {distribution: uniform, low: 0.8, high: 1.2}, aero.lift: {distribution: normal, "
    "sigma: 5 %}, atmosphere.density: {distribution: discrete, values: [0.99, 1.01]}}"
)


def fly_sum(plan, parameters, record_every=None):
    """A metric that is the lift's normal number, plus that of the drag's uniform number."""
    block = fly_line(plan, parameters, record_every)
    block.metrics[:] += 0.2 * stats.norm.ppf((parameters[:, [DRAG]] - 0.8) / 0.4)
    return block


SUM = Engine(prepare, fly_sum, "line")


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tighten")
    campaign = write_line(
        folder / "f",
        requirements="[{metric: altitude_error_max_m, below: 0.835, probability: 0.9}]",
        dispersions=LAWS,
        runs="2000",
        controllers="{one: one.yaml}",
        execution="{workers: 1, batch: 1000}",
    )
    return run(campaign, folder / "out", SUM).folder


def passing(width):
    """Return the probability that a flight passes if the lift has a share of its width."""
    return stats.norm.cdf(0.835 / np.hypot(width, 0.2))


def test_the_width_is_the_known_one_and_an_interrupted_search_resumes(flown, tmp_path):
    """4000 flights show 90 % if at most 337 fail, as expected up to 0.55 of the lift's width."""
    assert passing(0.55) > 1.0 - 337 / 4000 > passing(0.6)
    lift, drag = tighten(flown, output=tmp_path / "whole", engine=SUM).dispersions
    assert abs(lift.width - 0.5) < 0.051  # one step back
    assert passing(lift.width) > 0.9 == pytest.approx(passing(lift.reweighted), abs=0.03)
    assert lift.entry == {"distribution": "normal", "sigma": f"{5 * lift.width:g} %"}
    assert lift.verdict.status == "PASS" and lift.verdict.flights == 6000
    assert lift.verdict.failures / 6000 == pytest.approx(1.0 - passing(lift.width), abs=0.012)
    assert drag.reweighted == 0.0 and drag.width is None  # The lift alone fails too often.
    cut = tmp_path / "cut"
    with pytest.raises(KeyboardInterrupt):
        tighten(flown, output=cut, engine=interrupted_after(6, SUM))
    assert list((cut / "flights").glob("*.parquet"))
    assert tighten(flown, output=cut, engine=SUM).dispersions == (lift, drag)


@pytest.mark.parametrize("entry", [
    "uniform, low: 0.8, high: 150 %",
    "triangular, low: 0.8, high: 1.4, mode: 0.9",
    "truncated_normal, half_width: 0.2, sigma: 0.3",
])  # fmt: skip
def test_a_narrower_distribution_is_the_same_about_its_median(tmp_path, entry):
    laws = f"{{aero.drag: {{distribution: {entry}}}}}"
    campaign, name = read_campaign(write_line(tmp_path, dispersions=laws)), "aero.drag"
    marginal, levels = campaign.marginals[name], np.array([0.5, 0.01, 0.2, 0.9])
    keys = narrow(campaign.dispersions[name], marginal, campaign.parameters[name], 0.3)
    narrower = make_change(campaign, {name: keys}).marginals[name].ppf(levels)
    wide = marginal.ppf(levels)
    np.testing.assert_allclose(narrower, wide[0] + 0.3 * (wide - wide[0]), rtol=1e-5)


def test_the_command(flown, tmp_path, monkeypatch):
    monkeypatch.setattr("abhv_mc_vehicle.vehicle_simulator.simulator.make_engine", lambda: SUM)
    result = invoke("tighten", flown, "aero.drag", "-o", tmp_path / "drag")
    assert result.exit_code == 1 and "no PASS at any width" in result.stdout
    results = open_results(flown)
    with pytest.raises(InputError, match=r"'atmosphere\.density'.*'aero\.drag'"):
        results.tighten(dispersions=["atmosphere.density"])
    easy = results.judge([{"metric": "altitude_error_max_m", "below": 9, "probability": 0.9}])
    assert easy.tighten("one").verdict.status == "PASS"
