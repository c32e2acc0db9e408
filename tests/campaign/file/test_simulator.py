import math
from pathlib import Path

import numpy as np
import pytest
from own_simulators import dive_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.io.input_error import InputError, InputErrors


def test_quantities_stay_in_the_units_of_the_inputs(tmp_path: Path) -> None:
    campaign = read_campaign(dive_campaign(tmp_path))
    middle, side = np.array([0.5]), np.array([0.8413447460685429])  # one sigma above the middle
    expected = {"altitude": (2330.0, 50.0), "speed": (560.0, 28.0), "thrust": (1.0, 0.03)}
    for name, (mean, sigma) in expected.items():
        law = campaign.marginals[name]
        assert law.ppf(middle)[0] == mean
        assert math.isclose(law.ppf(side)[0], mean + sigma)
    assert campaign.marginals["delay"].at_fraction(np.array([0.0, 1.0])).tolist() == pytest.approx([1.0, 2.2])
    assert campaign.requirements[0].limits.low == 0.0
    assert campaign.metrics["altitude_min"].unit == "ft"


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"vehicle": "ghame.yaml"}, "unknown key 'vehicle'"),
        ({"margins": {"flights": "all"}}, "unknown key 'margins'"),
        ({"execution": {"flight_time_limit": "5 s"}}, "unknown key 'flight_time_limit'"),
        ({"keep": {"envelopes": {"rate": "5 Hz"}}}, "envelopes of no"),
        ({"keep": {"histories": {"channels": ["altitude_m"]}}, "histories": {"altitude": {}}}, "of this program's"),
        ({"dispersions": {"altitude": {"distribution": "normal", "sigma": "50 kg"}}}, "a mass"),
        ({"dispersions": {"height": {"distribution": "normal", "sigma": 50.0}}}, "unknown parameter 'height'"),
        (
            {"inputs": {"bias": {"unit": "ft"}}, "dispersions": {"bias": {"distribution": "normal", "sigma": "5 %"}}},
            "0",
        ),
        ({"metrics": {"dive": {}}, "requirements": []}, "taken"),
        ({"outcomes": {"ok": "It was well."}}, "taken"),
        ({"simulator": {"python": "no.py"}}, "no.py"),
        ({"simulator": {"python": "dive.py", "command": ["sh"]}}, "both"),
        ({"simulator": {"python": "dive.py", "files": ["model/*.csv"]}}, "names no file"),
        (
            {"requirements": [{"metric": "load", "below": 7.0, "probability": 0.9, "controllers": ["v3"]}]},
            "system 'v3'",
        ),
        ({"requirements": [{"metric": "load", "below": "7 ft", "probability": 0.9}]}, "7 ft"),
    ],
)
def test_what_makes_no_sense_is_refused(changes: dict[str, object], line: str, tmp_path: Path) -> None:
    with pytest.raises((InputError, InputErrors), match=line):
        read_campaign(dive_campaign(tmp_path, **changes))


def test_units_may_be_any_text(tmp_path: Path) -> None:
    inputs = {"turns": {"unit": "furlongs per fortnight", "nominal": 10.0}}
    laws = {"turns": {"distribution": "normal", "sigma": "2 furlongs per fortnight", "mean": 11.0}}
    campaign = read_campaign(dive_campaign(tmp_path, inputs=inputs, dispersions=laws))
    assert campaign.marginals["turns"].cdf(np.array([13.0]))[0] == pytest.approx(0.8413447)


def test_seeds_are_whole_numbers_of_each_flight(tmp_path: Path) -> None:
    inputs = {"altitude": {"unit": "ft", "nominal": 2330.0}, "noise": {"seed": "yes"}}
    laws = {"altitude": {"distribution": "normal", "sigma": 50.0}}
    seeds = read_campaign(dive_campaign(tmp_path, inputs=inputs, dispersions=laws)).make_samples()
    drawn = seeds.draw(0, 100)[:, 1]
    assert seeds.names == ("altitude", "noise")
    assert np.unique(drawn).size == 100
    assert np.array_equal(drawn, np.floor(drawn))
    assert drawn.max() < 2.0**53
    assert np.array_equal(seeds.draw(40, 50)[:, 1], drawn[40:50])
    grid = dive_campaign(tmp_path / "grid", inputs=inputs, dispersions=laws, sampling="corners", runs=None)
    assert np.unique(read_campaign(grid).make_samples().draw(0, 2)[:, 1]).size == 1


def test_derived_inputs_know_inputs_without_points(tmp_path: Path) -> None:
    campaign = read_campaign(dive_campaign(tmp_path, derived={"dive": "60 + 0.1 * (speed - 560)"}))
    rows = campaign.rows(campaign.make_samples().draw(0, 5))
    place = campaign.parameters.index
    assert np.allclose(rows[:, place["dive"]], 60.0 + 0.1 * (rows[:, place["speed"]] - 560.0))
