"""What a campaign can show, before it flies."""

import json
import sys

import pytest
from fake_flight import write_campaign
from scipy.stats import binom

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.cli.app import main
from abhv_mc.report.pages.planned import plan_numbers

TWO = "[{metric: altitude_error_max_m, below: 50, probability: 0.9973}, \
{metric: sideslip_max_deg, below: 1, probability: 0.99}]"


def plan(folder, **entries):
    return plan_numbers(read_campaign(write_campaign(folder, **{"requirements": TWO, "runs": "1000", **entries})))


def test_flights_for_failures_and_chances(tmp_path):
    numbers = plan(tmp_path)
    first, second = numbers["requirements"]
    assert first["flights_for_failures"] == {"0": 852, "1": 1440, "2": 1970, "3": 2473}
    assert (first["most_failures_at_runs"], second["most_failures_at_runs"]) == (0, 5)
    at_limit = numbers["rates_over_allowed"].index(1.0)
    assert 0.2 in numbers["rates_over_allowed"] and len(numbers["rates_over_allowed"]) == 41
    for entry in (first, second):
        assert entry["pass_chance"][0] == 1.0 and entry["pass_chance"][at_limit] < 0.12
        # Exact: that of a fixed campaign by the binomial law, that of looks by their plan.
        most = entry["most_failures_at_runs"]
        assert entry["false_pass"] == pytest.approx(binom.cdf(most, 1000, 1.0 - entry["probability"]))
        assert 0.05 < entry["false_pass"] <= 0.1 and 0.05 < entry["stop_when_proven"]["false_pass"] <= 0.1
        assert len(entry["stop_when_proven"]["expected_flights"]) == 41
    low, high = (numbers["together"]["fixed"][end][10] for end in ("low", "high"))
    assert 0.0 <= low <= high <= min(first["pass_chance"][10], second["pass_chance"][10]) + 1e-12
    assert numbers["any_false_pass"] == pytest.approx(0.4)  # two requirements on two controllers


def test_a_family_needs_more_flights(tmp_path):
    numbers = plan(tmp_path, family="{risk: 0.1}")
    assert numbers["requirements"][0]["flights_for_failures"]["0"] > 852 and numbers["any_false_pass"] == 0.1


def test_the_command_writes_numbers_and_a_figure(tmp_path, monkeypatch, capsys):
    path = write_campaign(tmp_path / "f", requirements=TWO, runs="400")
    words = ["abhv-mc", "plan", str(path), "--json", str(tmp_path / "p.json"), "-o", str(tmp_path / "out")]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as ended:
        main()
    found = capsys.readouterr()
    assert not ended.value.code and "852" in found.out and "no outcome of 400 flights" in found.err
    assert "of a false one **" in found.out and "stopping when proven" in found.out
    assert json.loads((tmp_path / "p.json").read_text())["requirements"][0]["most_failures_at_runs"] == -1
    assert (tmp_path / "out/plan.png").read_bytes()[:4] == b"\x89PNG"
