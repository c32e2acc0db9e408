"""Shipped campaigns beside the default one fly and pass through the report as they are."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.report.pages.build import build_report
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.shipped import shipped_campaigns

# Metrics of a channel's smallest and largest value, or one of its largest size, at any control tick.
ENDS = {
    "angle_of_attack_deg": ("angle_of_attack_min_deg", "angle_of_attack_max_deg"),
    "sideslip_deg": ("sideslip_max_deg",),
    "aileron_deg": ("aileron_max_deg",),
    "rudder_deg": ("rudder_max_deg",),
    "elevator_deg": ("elevator_max_deg",),
}
SHORTENED = {"wide": 60, "wind_and_sensors": 40}


def check_ranges(numbers, flights):
    """They said -13 to 5 deg where every flight reached 20.0: they were of samples, not of ticks."""
    of = np.array(flights["controller"].to_pylist())
    for controller, ranges in numbers["envelopes"]["ranges"].items():
        for channel, metrics in ENDS.items():
            columns = [flights[metric].to_numpy()[of == controller] for metric in metrics]
            low, high = ranges[channel]
            if len(metrics) == 2:
                assert (low, high) == pytest.approx((np.nanmin(columns[0]), np.nanmax(columns[1])), rel=1e-6), channel
            else:
                assert max(abs(low), abs(high)) == pytest.approx(np.nanmax(columns[0]), rel=1e-6), channel


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
    check_ranges(numbers, pq.read_table(flown.folder / "flights"))
    statuses = {
        entry["status"] for item in numbers["verdicts"]["requirements"] for entry in item["controllers"].values()
    }
    failed = {name: counts["failed"] for name, counts in numbers["flights"]["counts"].items()}
    if name == "wide":
        assert failed["tlc"] > 0 and failed["lqr"] > failed["tlc"] and "FAIL" in statuses
    else:
        assert failed == {"tlc": 0, "lqr": 0}
