"""Windows of metrics by the name of a mission's phase."""

import pytest

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.io.input_error import InputError
from abhv_mc.shipped import shipped_configs

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


def read(folder, window, name="turn"):
    (folder / "mission.yaml").write_text(MISSION.format(name=name))
    (folder / "campaign.yaml").write_text(CAMPAIGN.format(configs=shipped_configs(), window=window))
    return read_campaign(folder / "campaign.yaml")


def test_a_phase_is_the_window_between_its_beginning_and_its_end(tmp_path):
    by_name, by_times = (read(tmp_path, each).declared[0] for each in ("phase: turn", "from: 37 s, to: 47 s"))
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
        read(tmp_path, window, name)
