"""Requirements from CSV files, phase windows of metrics, and entries of user simulators."""

import json
import math

import numpy as np
import pytest
from fake_flight import write_campaign
from own_simulators import dive_campaign

from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.folder.inputs import collect_inputs
from abhv_mc.io.documents import write_document
from abhv_mc.io.messages import InputError, InputErrors
from abhv_mc.shipped import shipped_configs

TABLE = """\
id,text,source,metric,below,above,probability,consumer_risk,controllers
GNC-12,"The altitude is held, always",SRD 3.2,altitude_error_max_m,50 m,,99.73 %,0.05,
GNC-13,,SRD 3.3,equivalence_ratio_min,,0.1,0.9,,one; two
"""


def campaign(folder, table, **entries):
    path = write_campaign(folder, requirements="requirements.csv", **entries)
    (folder / "requirements.csv").write_text(table, encoding="utf-8")
    return path


def test_what_looks_right_and_would_be_left_out_is_refused(tmp_path):
    for entries, message in (
        ({"keep": "{histories: {flights: '5'}}"}, "'5'"),
        ({"execution": "{workers: }"}, r"\bnothing; .*'auto'"),
    ):
        with pytest.raises(InputError, match=message):
            read_campaign(write_campaign(tmp_path, **entries))


def test_a_table_reads_as_a_list(tmp_path):
    checked = read_campaign(campaign(tmp_path, TABLE))
    first, second = checked.model.requirements
    assert (first.id, first.text, first.source) == (
        "GNC-12",
        "The altitude is held, always",
        "SRD 3.2",
    )
    assert [item.limits for item in checked.requirements] == [Bounds(high=50.0), Bounds(low=0.1)]
    assert first.probability == pytest.approx(0.9973)
    assert (first.consumer_risk, second.consumer_risk) == (0.05, 0.10)
    assert second.controllers == ("one", "two") and second.above == 0.1 and second.text is None
    both = TABLE.replace("equivalence_ratio_min,,0.1", "equivalence_ratio_min,0.5,0.1")
    assert read_campaign(campaign(tmp_path, both)).requirements[1].limits == Bounds(0.1, 0.5)
    assert read_campaign(tmp_path / "campaign.yaml", controllers=["one"]).model.requirements[
        1
    ].controllers == ("one",)


@pytest.mark.parametrize(
    ("old", "new", "location"),
    [
        ("50 m", "50 furlongs", r"requirements.csv:2:68: .*furlongs"),
        ("GNC-13", "GNC-12", r"requirements.csv:3:1: .*GNC-12"),
        ("altitude_error_max_m", "altitude_error", r"requirements.csv:2:47: .*altitude_error"),
        (
            "equivalence_ratio_min,,0.1",
            "equivalence_ratio_min,0.1,0.5",
            "requirements.csv:3:.*below 0.1 and above 0.5",
        ),
        ("99.73 %", "199 %", "requirements.csv:2:74: "),
        (",below,", ",belov,", "requirements.csv:1:23: "),
        ("equivalence_ratio_min,,0.1", "equivalence_ratio_min,,", "requirements.csv:3:1: "),
        ("one; two", "one, two", "requirements.csv:3: found 10 cells"),
        (",metric,", ",rationale,", "requirements.csv:1:1: the column 'metric' is missing"),
    ],
)
def test_mistakes_are_told_with_line_and_column_of_the_table(tmp_path, old, new, location):
    with pytest.raises(InputError, match=location):
        read_campaign(campaign(tmp_path, TABLE.replace(old, new)))


MISSION = """\
name: climb and turn
start: {{altitude: 20 km, speed: 1400 m/s, heading: 90 deg, latitude: 29.3 deg}}
start_time: 2 s
duration: 60 s
manoeuvre:
  kind: phases
  phases:
    - {{kind: level, length: 5 s}}
    - {{kind: climb, altitude_change: 500 m, length: 30 s, name: climb}}
    - {{kind: turn, heading_change: 8 deg, length: 10 s, name: {name}}}
"""
CAMPAIGN = """\
name: phases
vehicle: {configs}/vehicle/ghame_x.yaml
mission: mission.yaml
controllers:
  tlc: {configs}/control/tlc.yaml
runs: 4
dispersions:
  aero.lift: {{distribution: uniform, half_width: 10 %}}
metrics:
  swing_deg: {{of: bank_error_deg, statistic: peak_to_peak, {window}}}
"""


def read_phases(folder, window, name="turn"):
    (folder / "mission.yaml").write_text(MISSION.format(name=name))
    (folder / "campaign.yaml").write_text(CAMPAIGN.format(configs=shipped_configs(), window=window))
    return read_campaign(folder / "campaign.yaml")


def test_a_phase_is_the_window_between_its_beginning_and_its_end(tmp_path):
    by_name, by_times = (
        read_phases(tmp_path, window).contents.declared[0]
        for window in ("phase: turn", "from: 37 s, to: 47 s")
    )
    assert (by_name.start, by_name.end) == (37.0, 47.0)
    assert by_name == by_times


@pytest.mark.parametrize(
    ("window", "name", "message"),
    [
        ("phase: descent", "turn", "campaign.yaml:10.*'descent'.*climb"),
        ("phase: climb, to: 9 s", "turn", "campaign.yaml:10.*'phase'"),
        ("phase: climb", "climb", "mission.yaml:10.*'climb'"),
    ],
)
def test_another_phase_is_refused_with_its_place(tmp_path, window, name, message):
    with pytest.raises(InputError, match=message):
        read_phases(tmp_path, window, name)


VALUES = np.array([2.8, 3.0, 3.1, 49.9, 50.0, 50.1, np.nan])


@pytest.mark.parametrize(
    ("limits", "met_indices", "most"),
    [
        (Bounds(high=50.0), [0, 1, 2, 3], 0.1),
        (Bounds(low=3.0), [2, 3, 4, 5], 0.2),
        (Bounds(3.0, 50.0), [2, 3], 0.2),
    ],
    ids=str,
)
def test_a_value_at_a_limit_or_none_fails(limits, met_indices, most):
    failed = limits.failures(VALUES)
    assert np.flatnonzero(~failed).tolist() == met_indices
    beyond = limits.worse(VALUES) - limits.limit
    np.testing.assert_array_equal(failed, ~(beyond < 0.0))
    assert np.nanmax(beyond) == pytest.approx(most)


def test_of_two_limits_a_distance_is_a_share_of_half_their_distance():
    assert Bounds(3.0, 50.0).size == 23.5 and Bounds(low=-3.0).size == 3.0
    assert Bounds(3.0, 50.0).worse(np.array([26.5])) == -23.5


def test_an_early_end_fails_and_measured_failures_stay():
    early = np.array([True, False])
    assert Bounds(high=50.0).failures(np.array([1.0, 60.0]), early).tolist() == [True, True]
    assert Bounds(high=50.0).failures(np.array([1.0, 1.0]), early & False).tolist() == [
        False,
        False,
    ]


def test_quantities_stay_in_the_units_of_the_inputs(tmp_path):
    campaign = read_campaign(dive_campaign(tmp_path))
    middle, side = np.array([0.5]), np.array([0.8413447460685429])  # one sigma above the middle
    expected = {"altitude": (2330.0, 50.0), "speed": (560.0, 28.0), "thrust": (1.0, 0.03)}
    for name, (mean, sigma) in expected.items():
        law = campaign.marginals[name]
        assert law.ppf(middle)[0] == mean
        assert math.isclose(law.ppf(side)[0], mean + sigma)
    assert campaign.marginals["delay"].at_fraction(np.array([0.0, 1.0])).tolist() == pytest.approx(
        [1.0, 2.2]
    )
    assert campaign.requirements[0].limits.low == 0.0
    assert campaign.metrics["altitude_min"].unit == "ft"


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"vehicle": "ghame.yaml"}, "unknown key 'vehicle'"),
        ({"margins": {"flights": "all"}}, "unknown key 'margins'"),
        ({"execution": {"flight_time_limit": "5 s"}}, "unknown key 'flight_time_limit'"),
        ({"keep": {"envelopes": {"rate": "5 Hz"}}}, "envelopes"),
        (
            {"keep": {"histories": {"channels": ["altitude_m"]}}, "histories": {"altitude": {}}},
            "unknown key .channels.",
        ),
        ({"dispersions": {"altitude": {"distribution": "normal", "sigma": "50 kg"}}}, "a mass"),
        (
            {"dispersions": {"height": {"distribution": "normal", "sigma": 50.0}}},
            "unknown parameter 'height'",
        ),
        (
            {
                "inputs": {"bias": {"unit": "ft"}},
                "dispersions": {"bias": {"distribution": "normal", "sigma": "5 %"}},
            },
            "0",
        ),
        ({"metrics": {"dive": {}}, "requirements": []}, "in use"),
        ({"outcomes": {"ok": "It was well."}}, "in use"),
        ({"simulator": {"python": "no.py"}}, "no.py"),
        ({"simulator": {"python": "dive.py", "command": ["sh"]}}, "both"),
        ({"simulator": {"python": "dive.py", "files": ["model/*.csv"]}}, r"\.csv"),
        (
            {
                "requirements": [
                    {"metric": "load", "below": 7.0, "probability": 0.9, "controllers": ["v3"]}
                ]
            },
            "system 'v3'",
        ),
        ({"requirements": [{"metric": "load", "below": "7 ft", "probability": 0.9}]}, "7 ft"),
    ],
)
def test_what_makes_no_sense_is_refused(changes, line, tmp_path):
    with pytest.raises((InputError, InputErrors), match=line):
        read_campaign(dive_campaign(tmp_path, **changes))


def test_units_may_be_any_text(tmp_path):
    inputs = {"turns": {"unit": "furlongs per fortnight", "nominal": 10.0}}
    laws = {"turns": {"distribution": "normal", "sigma": "2 furlongs per fortnight", "mean": 11.0}}
    campaign = read_campaign(dive_campaign(tmp_path, inputs=inputs, dispersions=laws))
    assert campaign.marginals["turns"].cdf(np.array([13.0]))[0] == pytest.approx(0.8413447)


def test_seeds_are_whole_numbers_of_each_flight(tmp_path):
    inputs = {"altitude": {"unit": "ft", "nominal": 2330.0}, "noise": {"seed": "yes"}}
    laws = {"altitude": {"distribution": "normal", "sigma": 50.0}}
    seeds = read_campaign(dive_campaign(tmp_path, inputs=inputs, dispersions=laws)).make_samples()
    drawn = seeds.draw(0, 100)[:, 1]
    assert seeds.names == ("altitude", "noise")
    assert np.unique(drawn).size == 100
    assert np.array_equal(drawn, np.floor(drawn))
    assert drawn.max() < 2.0**53
    assert np.array_equal(seeds.draw(40, 50)[:, 1], drawn[40:50])
    grid = dive_campaign(
        tmp_path / "grid", inputs=inputs, dispersions=laws, sampling="corners", runs=None
    )
    assert np.unique(read_campaign(grid).make_samples().draw(0, 2)[:, 1]).size == 1


def test_derived_inputs_know_inputs_without_points(tmp_path):
    campaign = read_campaign(dive_campaign(tmp_path, derived={"dive": "60 + 0.1 * (speed - 560)"}))
    rows = campaign.rows(campaign.make_samples().draw(0, 5))
    index = campaign.parameters.index
    assert np.allclose(rows[:, index["dive"]], 60.0 + 0.1 * (rows[:, index["speed"]] - 560.0))


INPUTS = """name;unit;nominal;seed;distribution;sigma;half_width
a;m;10.5;;normal;1 m;
b;-;1;;uniform;;2 %
c;s;3;;;;
n;;;true;;;
"""


def of_tables(folder, inputs=INPUTS, requirements=2000):
    rows = "".join(f"R-{i},miss,15 m,97 %,high\n" for i in range(requirements))
    (folder / "requirements.csv").write_text(f"id,metric,below,probability,text\n{rows}")
    (folder / "inputs.csv").write_text(inputs)
    content = {
        "name": "tables",
        "inputs": "inputs.csv",
        "metrics": {"miss": {"unit": "m"}},
        "requirements": "requirements.csv",
        "runs": 100,
    }
    (folder / "tables.yaml").write_text(json.dumps(content))
    return folder / "tables.yaml"


def test_a_missing_key_of_a_campaign_with_tables_is_missing_in_the_campaign(tmp_path):
    path = of_tables(tmp_path, requirements=1)
    path.write_text(path.read_text().replace('"runs": 100', '"seed": 1'))
    with pytest.raises(InputError, match=r"tables\.yaml:1:1: .*'runs'"):
        read_campaign(path)


def test_tables_hold_the_inputs_and_more_requirements_than_a_file(tmp_path):
    campaign = read_campaign(of_tables(tmp_path))
    assert [
        (record.name, record.unit, record.nominal) for record in campaign.parameters.records
    ] == [
        ("a", "m", 10.5),
        ("b", "-", 1.0),
        ("c", "s", 3.0),
        ("n", "-", 0.0),
    ]
    assert campaign.parameters["n"].seed and list(campaign.marginals) == ["a", "b"]
    assert campaign.marginals["b"].ppf(np.array([1.0])) == pytest.approx(1.02)
    assert len(campaign.requirements) == 2000
    write_document(tmp_path / "again.yaml", campaign.document.data)  # as a folder keeps it
    assert read_campaign(tmp_path / "again.yaml").requirements == campaign.requirements


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("name;", "nam;", "inputs.csv:1:1: the column 'name' is missing"),
        ("\nb;", "\na;", "inputs.csv:3: the input 'a'"),
        ("normal", "normall", r"inputs.csv:2:11: .*normall"),
        ("10.5", "ten", "inputs.csv:2:5: .*ten"),
        ("normal;1 m", "normal;1 kg", r"inputs.csv:2:18: .*a mass"),
    ],
)
def test_mistakes_in_a_table_of_inputs_are_told_with_their_row(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        read_campaign(of_tables(tmp_path, INPUTS.replace(old, new), requirements=1))


def test_a_campaign_names_shipped_parts(tmp_path):
    drag = {"aero.drag": {"distribution": "uniform", "half_width": "5 %"}}
    parts = {"vehicle": "f16", "mission": "f16_level", "controllers": {"own": "lqr"}}
    content = {"name": "c", "runs": 2, "seed": 1, "sampling": "random", "dispersions": drag}
    write_document(tmp_path / "c.yaml", parts | content)
    stored = collect_inputs(read_campaign(tmp_path / "c.yaml")).data
    assert (stored["vehicle"], stored["mission"]) == (
        "inputs/vehicle/f16.yaml",
        "inputs/mission/f16_level.yaml",
    )
    assert stored["controllers"] == {"own": "inputs/controllers/own/lqr.yaml"}
