"""Every shipped campaign is valid, and those beside the default one fly and pass through the report as they are."""

import html
import json
import re

import numpy as np
import pyarrow.parquet as pq
import pytest

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.report.pages.build import build_report
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.shipped import shipped_campaigns

# Channel of a figure: metrics of its smallest and largest value, or one of its largest size, at any control tick.
ENDS = {
    "Speed": ("speed_error_max_mps",),
    "Angle of attack": ("angle_of_attack_min_deg", "angle_of_attack_max_deg"),
    "Sideslip": ("sideslip_max_deg",),
    "Aileron": ("aileron_max_deg",),
    "Rudder": ("rudder_max_deg",),
    "Elevator": ("elevator_max_deg",),
}
RANGE = r"(\N{MINUS SIGN}?[\d.\u202f]+) to (\N{MINUS SIGN}?[\d.\u202f]+)"
FILES = sorted(shipped_campaigns().glob("*.yaml"))
SHORTENED = {"wide": 60, "wind_and_sensors": 40}


@pytest.mark.parametrize("path", FILES, ids=[path.stem for path in FILES])
def test_it_is_valid_and_asks_something(path):
    checked = read_campaign(path)
    assert checked.model.name == path.stem and checked.model.question.endswith("?")
    assert checked.runs >= 200


def number(text):
    return float(text.replace("\N{MINUS SIGN}", "-").replace("\u202f", ""))


def check_captions(page, numbers, flights):
    """Captions said 'TLC -13 to 5 deg' where every flight reached 20.0: their ranges were of samples, not of ticks."""
    title = r"<strong>(?:Altitude and )?(\w[\w ]*?)(?: angle)?\.</strong>"
    captions = dict(re.findall(rf"^ *<figcaption>{title} (.*)$", page, re.M))
    captions = {title.capitalize(): html.unescape(caption) for title, caption in captions.items()}
    of = np.array(flights["controller"].to_pylist())
    for title, metrics in ENDS.items():
        here = captions[title].rpartition(" Here: ")[2]
        for name, label in numbers["provenance"]["labels"].items():
            low, high = re.search(rf"(?:^|; ){re.escape(label)} {RANGE}", here).groups()
            digit = 0.51 * 10.0 ** -len(low.partition(".")[2])  # of the last place, rounded
            ends = [number(low) - 1400.0 * (title == "Speed"), number(high) - 1400.0 * (title == "Speed")]
            columns = [flights[metric].to_numpy()[of == name] for metric in metrics]
            if len(metrics) == 2:
                assert ends == pytest.approx([np.nanmin(columns[0]), np.nanmax(columns[1])], abs=digit), (title, name)
            else:
                assert max(map(abs, ends)) == pytest.approx(np.nanmax(columns[0]), abs=digit), (title, name)


@pytest.mark.parametrize("name", SHORTENED)
def test_it_flies_and_its_report_follows_from_the_data(name, engine, tmp_path):
    path = shipped_campaigns() / f"{name}.yaml"
    flown = run_campaign(Request(path, tmp_path / name, SHORTENED[name]), engine)
    assert flown.complete
    page = build_report(flown.folder).read_text(encoding="utf-8")
    numbers = json.loads((flown.folder / "report.json").read_text(encoding="utf-8"))
    question = read_campaign(path).model.question
    assert f"<h1>{question}</h1>" in page
    assert list(verify_campaign(flown.folder)) == []
    check_captions(page, numbers, pq.read_table(flown.folder / "flights"))
    statuses = {
        entry["status"] for item in numbers["verdicts"]["requirements"] for entry in item["controllers"].values()
    }
    failed = {name: counts["failed"] for name, counts in numbers["flights"]["counts"].items()}
    if name == "wide":
        assert failed["tlc"] > 0 and failed["lqr"] > failed["tlc"] and "FAIL" in statuses
    else:
        assert failed == {"tlc": 0, "lqr": 0}
