"""What a campaign can show, before it flies."""

import json

import pytest
from fake_flight import write_campaign
from scipy.stats import binom

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.report.numbers.planned import plan_campaign
from abhv_mc.topics.plain import plain

TWO = "[{metric: altitude_error_max_m, below: 50, probability: 0.9973}, \
{metric: sideslip_max_deg, below: 1, probability: 0.99}]"


def plan(folder, **entries):
    return plain(
        plan_campaign(read_campaign(write_campaign(folder, **{"requirements": TWO, "runs": "1000", **entries})))
    )


def test_flights_for_failures_and_chances(tmp_path):
    numbers = plan(tmp_path)
    first, second = numbers["requirements"]
    assert first["flights_for_failures"] == {"0": 981, "1": 2235, "2": 3086, "3": 3831}
    assert (first["most_failures_at_runs"], second["most_failures_at_runs"]) == (0, 2)
    at_limit, fifth = (numbers["rates_over_allowed"].index(rate) for rate in (1.0, 0.2))
    for entry in (first, second):
        assert [chance["runs"] for chance in entry["pass_chance"]] == [1000, 2000, 4000]
        for chance in entry["pass_chance"]:
            assert chance["at_some_flight"][0] == 1.0 and chance["at_some_flight"][at_limit] <= 0.1
            assert all(ever >= at - 1e-12 for ever, at in zip(chance["at_some_flight"], chance["at_runs"], strict=True))
    assert first["pass_chance"][0]["at_runs"][fifth] == pytest.approx(binom.cdf(0, 1000, 0.2 * 0.0027))
    low, high = (numbers["together"][0]["at_runs"][end][10] for end in ("low", "high"))
    assert 0.0 <= low <= high <= first["pass_chance"][0]["at_runs"][10] + 1e-12


def test_a_family_needs_more_flights(tmp_path):
    numbers = plan(tmp_path, family="{risk: 0.1}")
    assert numbers["requirements"][0]["flights_for_failures"]["0"] > 981 and numbers["family_risk"] == 0.1


def test_the_command_writes_numbers_and_a_figure(abhv_mc, tmp_path):
    path = write_campaign(tmp_path / "f", requirements=TWO, runs="400")
    code, out, err = abhv_mc("plan", path, "--json", tmp_path / "p.json", "-o", tmp_path / "out")
    assert code == 0 and "981" in out and "no outcome of 400 flights" in err
    assert json.loads((tmp_path / "p.json").read_text())["requirements"][0]["most_failures_at_runs"] == -1
    assert (tmp_path / "out/plan.png").read_bytes()[:4] == b"\x89PNG"
