"""A requirement with both limits: one verdict, ranking and tolerance by the distance outside them, everywhere."""

import csv
import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, write_campaign
from report.synthetic import build_with
from typer.testing import CliRunner

from abhv_mc.cli.app import app
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.statistics.evidence import most_failures

METRIC, LOW, HIGH = "altitude_error_max_m", 0.4, 2.3
ASKED = f"[{{metric: {METRIC}, above: {LOW}, below: {HIGH}, probability: 0.5}}]"
KEEP = "{histories: {flights: worst 40, rate: 10 Hz}, envelopes: {rate: 5 Hz}}"


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("corridor")
    path = write_campaign(folder / "f", requirements=ASKED, keep=KEEP)
    out = folder / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("abhv_mc.execution.runner.make_engine", lambda: ENGINE)
        done = CliRunner().invoke(app, ["run", str(path), "-o", str(out), "--no-report"])
    assert done.exit_code in (0, 1), done.output
    build_with(out)
    table = pq.read_table(out / "flights").to_pandas()
    return out, table[table["controller"] == "one"].sort_values("flight"), done.output


def test_whoever_is_on_either_side_of_the_band_fails(flown):
    out, table, words = flown
    values, lost = table[METRIC].to_numpy(), (table["outcome"] != "ok").to_numpy()
    failed = lost | (values <= LOW) | (values >= HIGH)
    assert (values[~lost] <= LOW).any() and (values[~lost] >= HIGH).any() and not failed.all()
    manifest = json.loads((out / "manifest.json").read_text("utf-8"))
    (entry,) = manifest["requirements"]
    assert (entry["above"], entry["below"], entry["failures"]) == (LOW, HIGH, int(failed.sum()))
    assert f"{METRIC} between 0.4 and 2.3" in " ".join(words.split())
    with (out / "verification_matrix.csv").open(newline="") as file:
        row = next(csv.DictReader(file))
    assert (row["above"], row["below"], row["failures"]) == ("0.4", "2.3", str(failed.sum()))


def test_the_report_ranks_and_bounds_by_the_distance_outside(flown):
    out, table, _ = flown
    numbers = json.loads((out / "report.json").read_text("utf-8"))
    values, lost = table[METRIC].to_numpy(), (table["outcome"] != "ok").to_numpy()
    outside = np.where(lost, np.inf, np.maximum(LOW - values, values - HIGH))
    (entry,) = numbers["verdicts"]["requirements"]
    found = entry["controllers"]["one"]
    assert "between 0.4 and 2.3" in entry["words"]
    k = most_failures(len(values), 0.5, 0.1)
    assert found["tolerance_limit"] == pytest.approx(np.sort(outside)[::-1][k])
    assert found["room"] == pytest.approx(-found["tolerance_limit"] / 0.95)
    cell = numbers["verdicts"]["glance"][0]["cells"]["one"]
    assert cell["median"] == pytest.approx(np.percentile(outside, 50.0, method="nearest"))
    listed = [item["flight"] for item in numbers["flights"]["worst"]["one"]]
    assert [outside[flight] for flight in listed] == np.sort(outside)[::-1][:40].tolist()
    assert not list(verify_campaign(out))
