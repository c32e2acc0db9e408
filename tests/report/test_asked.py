"""What a campaign asks for heads the answer and rules the rest: a metric that is bad below, a band of two limits."""

import csv
import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import run, write_campaign
from report.synthetic import build_with

from abhv_mc.api import compare
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.folder.flights import END_TIME
from abhv_mc.io.input_error import InputError
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.search.rare import RareSettings, find_rare
from abhv_mc.search.search_flights import SearchRequest
from abhv_mc.statistics.evidence import most_failures

LOW = "altitude_low_m"
CAMPAIGN = """\
name: low
question: Does the vehicle stay above 19990 m?
vehicle: {configs}/vehicle/ghame_x.yaml
mission: {configs}/mission/s_manoeuvre.yaml
controllers: {{tlc: {configs}/control/tlc.yaml, lqr: {configs}/control/lqr.yaml}}
runs: 96
seed: 1
dispersions:
  atmosphere.density: {{distribution: uniform, half_width: 10 %}}
  aero.lift: {{distribution: uniform, half_width: 10 %}}
metrics:
  altitude_low_m: {{of: altitude_m, statistic: min}}
requirements:
"""
ABOVE = "  - {metric: altitude_low_m, above: 19990 m, probability: 0.9}\n"
BELOW = "  - {metric: altitude_low_m, below: 20100 m, probability: 0.9}\n"


def write(folder, repository, requirements=ABOVE):
    path = folder / "campaign.yaml"
    path.write_text(CAMPAIGN.format(configs=repository / "configs") + requirements, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def flown(repository, tmp_path_factory, flights_only):
    folder = tmp_path_factory.mktemp("asked")
    out = run(write(folder, repository), folder / "out", flights_only).folder
    return out, build_with(out).read_text(encoding="utf-8"), json.loads((out / "report.json").read_text("utf-8"))


def test_it_heads_the_answer_and_its_smallest_value_is_the_worst(flown):
    _, page, numbers = flown
    assert numbers["metrics"]["asked"] == [LOW] and next(iter(numbers["metrics"]["table"])) == LOW
    assert numbers["verdicts"]["requirements"][0]["controllers"]["tlc"]["failures"] == 17
    cell = numbers["metrics"]["table"][LOW]["controllers"]["tlc"]
    assert cell["worst_flight"] == 10 and cell["worst"] == pytest.approx(19980.69, abs=0.01)
    assert numbers["comparison"]["pairs"]["tlc - lqr"]["metrics"][LOW]["winner"] == "lqr"
    assert page.index("Altitude low (m)") < page.index("Aileron, rms (deg)") and "small is bad" in page


def test_the_worst_flights_are_those_that_are_kept(flown):
    out, _, numbers = flown
    for name, listed in numbers["flights"]["worst"].items():
        kept = pq.read_table(out / "histories", filters=[("controller", "=", name)], partitioning=None)["flight"]
        assert {entry["flight"] for entry in listed} == set(kept.to_pylist()) and len(listed) == 20
        values = [entry["metrics"][LOW] for entry in listed]
        assert values == sorted(values)
    assert numbers["flights"]["worst"]["tlc"][0]["flight"] == 10


def test_the_folder_says_what_is_bad_and_follows_from_itself(flown):
    out, _, _ = flown
    schema = pq.read_schema(next(iter((out / "flights").glob("*.parquet"))))
    words = schema.field(LOW).metadata
    assert words[b"bad"] == b"low" and words[b"unit"] == b"m" and words[b"label"] == b"Altitude low"
    assert b"bad" not in schema.field(END_TIME.name).metadata
    assert not list(verify_campaign(out))


def test_a_gate_takes_it_on_its_bad_side(flown):
    (pair,) = compare(flown[0], flown[0], ("lqr", "tlc"), {LOW: 1e-6})["paired"]
    assert not pair["not_worse"][LOW]["shown"]
    (pair,) = compare(flown[0], flown[0], ("tlc", "lqr"), {LOW: 1e-6})["paired"]
    assert pair["not_worse"][LOW]["shown"]


def test_a_requirement_rules_the_side(repository, tmp_path):
    campaign = read_campaign(write(tmp_path, repository, BELOW))
    assert campaign.metrics[LOW].bad == "high" and campaign.criteria[0].bad == "high"


def test_margins_are_no_rare_event(repository, tmp_path, flights_only):
    """Many flights share their values at both ends, where no level can grow."""
    margin = "  - {metric: gain_margin_min_db, above: 6, probability: 0.9}\nmargins: {at: [trim], flights: all}\n"
    request = SearchRequest(write(tmp_path, repository, margin), tmp_path / "out")
    with pytest.raises(InputError, match="many flights share the value 0 or 60"):
        find_rare(request, RareSettings("gain_margin_min_db"), flights_only)


METRIC, LEAST, MOST = "altitude_error_max_m", 0.4, 2.3
BAND = f"[{{metric: {METRIC}, above: {LEAST}, below: {MOST}, probability: 0.5}}]"
KEEP = "{histories: {flights: worst 40, rate: 10 Hz}, envelopes: {rate: 5 Hz}}"


@pytest.fixture(scope="module")
def banded(tmp_path_factory):
    """The folder, the flights of its first controller, and the distance of each outside the band."""
    folder = tmp_path_factory.mktemp("corridor")
    out = run(write_campaign(folder / "f", requirements=BAND, keep=KEEP), folder / "out").folder
    build_with(out)
    table = pq.read_table(out / "flights").to_pandas()
    table = table[table["controller"] == "one"].sort_values("flight")
    values = table[METRIC].to_numpy()
    outside = np.where(table["outcome"] == "ok", np.maximum(LEAST - values, values - MOST), np.inf)
    assert (values <= LEAST).any() and (values >= MOST).any() and (outside < 0.0).any()
    return out, outside


def test_whoever_is_on_either_side_of_the_band_fails(banded):
    out, outside = banded
    (entry,) = json.loads((out / "manifest.json").read_text("utf-8"))["requirements"]
    assert (entry["above"], entry["below"], entry["failures"]) == (LEAST, MOST, int((outside >= 0.0).sum()))
    with (out / "verification_matrix.csv").open(newline="") as file:
        row = next(csv.DictReader(file))
    assert (row["above"], row["below"], row["failures"]) == ("0.4", "2.3", str(entry["failures"]))


def test_the_report_ranks_and_bounds_by_the_distance_outside(banded):
    out, outside = banded
    numbers = json.loads((out / "report.json").read_text("utf-8"))
    (entry,) = numbers["verdicts"]["requirements"]
    found = entry["controllers"]["one"]
    assert "between 0.4 and 2.3" in entry["words"]
    k = most_failures(len(outside), 0.5, 0.1)
    assert found["tolerance_limit"] == pytest.approx(np.sort(outside)[::-1][k])
    assert found["room"] == pytest.approx(-found["tolerance_limit"] / 0.95)
    cell = numbers["verdicts"]["glance"][0]["cells"]["one"]
    assert cell["median"] == pytest.approx(np.percentile(outside, 50.0, method="nearest"))
    listed = [item["flight"] for item in numbers["flights"]["worst"]["one"]]
    assert [outside[flight] for flight in listed] == np.sort(outside)[::-1][:40].tolist()
    assert not list(verify_campaign(out))
