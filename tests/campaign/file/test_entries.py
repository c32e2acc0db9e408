"""Requirements from a CSV file are those that the campaign could list itself, with the places of the table; windows of
metrics by the name of a mission's phase."""

import pytest
from fake_flight import write_campaign

from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.io.input_error import InputError
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
    for entries, words in (
        ({"keep": "{histories: {flights: '5'}}"}, "'5'.*or a flight's number"),
        ({"execution": "{workers: }"}, "nothing; expected 'auto' or a whole number"),
    ):
        with pytest.raises(InputError, match=words):
            read_campaign(write_campaign(tmp_path, **entries))


def test_a_table_reads_as_a_list(tmp_path):
    checked = read_campaign(campaign(tmp_path, TABLE))
    first, second = checked.model.requirements
    assert (first.id, first.text, first.source) == ("GNC-12", "The altitude is held, always", "SRD 3.2")
    assert [item.limits for item in checked.requirements] == [Bounds(high=50.0), Bounds(low=0.1)]
    assert first.probability == pytest.approx(0.9973)
    assert (first.consumer_risk, second.consumer_risk) == (0.05, 0.10)
    assert second.controllers == ("one", "two") and second.above == 0.1 and second.text is None
    both = TABLE.replace("equivalence_ratio_min,,0.1", "equivalence_ratio_min,0.5,0.1")
    assert read_campaign(campaign(tmp_path, both)).requirements[1].limits == Bounds(0.1, 0.5)
    assert read_campaign(tmp_path / "campaign.yaml", controllers=["two"]).model.requirements[1].controllers == ("two",)


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("50 m", "50 furlongs", r"campaign.yaml:.*furlongs"),  # the metric's unit is the campaign's business
        ("GNC-13", "GNC-12", r"campaign.yaml:.*GNC-12"),
        ("equivalence_ratio_min,,0.1", "equivalence_ratio_min,0.1,0.5", "campaign.yaml:.*below 0.1 and above 0.5"),
        ("99.73 %", "199 %", "requirements.csv:2:7: "),
        (",below,", ",belov,", "requirements.csv:1:5: "),
        ("equivalence_ratio_min,,0.1", "equivalence_ratio_min,,", "requirements.csv:3:1: "),
        ("one; two", "one, two", "requirements.csv:3:10: "),
        (",metric,", ",rationale,", "requirements.csv:1:1: no column 'metric'"),
    ],
)
def test_mistakes_are_told_with_line_and_column_of_the_table(tmp_path, old, new, place):
    with pytest.raises(InputError, match=place):
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
    by_name, by_times = (read_phases(tmp_path, each).declared[0] for each in ("phase: turn", "from: 37 s, to: 47 s"))
    assert (by_name.start, by_name.end) == (37.0, 47.0)
    assert by_name == by_times


@pytest.mark.parametrize(
    ("window", "name", "words"),
    [
        ("phase: descent", "turn", "campaign.yaml:10.*'descent'.*climb"),
        ("phase: climb, to: 9 s", "turn", "campaign.yaml:10.*'phase' beside 'from' or 'to'"),
        ("phase: climb", "climb", "mission.yaml:10.*'climb' twice"),
    ],
)
def test_another_phase_is_refused_with_its_place(tmp_path, window, name, words):
    with pytest.raises(InputError, match=words):
        read_phases(tmp_path, window, name)
