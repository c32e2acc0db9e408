"""Effect of requirements on a report, for a metric with a lower limit and one with two limits."""

import csv
import json
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, run, write_campaign
from report.synthetic import build_page

from abhv_mc.api import compare
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.folder.flights import END_TIME
from abhv_mc.io.messages import InputError
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.requests import RareRequest
from abhv_mc.search.rare import find_rare
from abhv_mc.statistics.evidence import most_failures
from abhv_mc.topics.metrics import SMALL_IS_BAD
from abhv_mc_vehicle.flight.metrics import BUILT_IN

LOW, BAND = "angle_of_attack_min_deg", "altitude_error_max_m"
LIMIT, LEAST, MOST = -0.9, 0.4, 2.3


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Run a campaign with one requirement; give folder, page, numbers and flights of 'one'."""

    def fly(requirement, half_width):
        folder = tmp_path_factory.mktemp("asked")
        dispersed = f"{{atmosphere.density: {{distribution: uniform, half_width: {half_width}}}, \
aero.lift: {{distribution: normal, sigma: 5 %}}}}"
        keep = "{histories: {flights: worst 20, rate: 10 Hz}, envelopes: {rate: 5 Hz}}"
        out = run(
            write_campaign(
                folder / "f", requirements=f"[{requirement}]", dispersions=dispersed, keep=keep
            ),
            folder / "out",
        ).folder
        page = build_page(out).read_text("utf-8")
        numbers = json.loads((out / "report.json").read_text("utf-8"))
        table = pq.read_table(out / "flights").to_pandas()
        return SimpleNamespace(
            out=out,
            page=page,
            numbers=numbers,
            one=table[table["controller"] == "one"].sort_values("flight"),
        )

    return fly


@pytest.fixture(scope="module")
def low(flown):
    """Run a campaign with a lower limit; no flight is lost."""
    return flown(f"{{metric: {LOW}, above: {LIMIT}, probability: 0.9}}", "5 %")


@pytest.fixture(scope="module")
def band(flown):
    campaign = flown(f"{{metric: {BAND}, above: {LEAST}, below: {MOST}, probability: 0.5}}", "10 %")
    values = campaign.one[BAND].to_numpy()
    campaign.outside = np.where(
        campaign.one["outcome"] == "ok", np.maximum(LEAST - values, values - MOST), np.inf
    )
    assert (values <= LEAST).any() and (values >= MOST).any() and (campaign.outside < 0.0).any()
    return campaign


def test_what_is_bad_below_heads_the_answer_and_its_smallest_value_is_the_worst(low):
    table, values = low.numbers["metrics"]["table"], low.one[LOW].to_numpy()
    assert low.numbers["metrics"]["asked"] == [LOW] and next(iter(table)) == LOW
    verdict = low.numbers["verdicts"]["requirements"][0]["controllers"]["one"]
    assert verdict["failures"] == (values <= LIMIT).sum() > 0
    cell = table[LOW]["controllers"]["one"]
    assert (cell["worst_flight"], cell["worst"]) == (values.argmin(), values.min())
    assert low.numbers["comparison"]["pairs"]["one - two"]["metrics"][LOW]["winner"] == "one"
    first, last = (BUILT_IN[name].label_with_unit for name in (LOW, "aileron_rms_deg"))
    assert low.page.index(first) < low.page.index(last)
    assert SMALL_IS_BAD in low.page


def test_the_worst_flights_are_those_that_are_kept(low):
    for name, listed in low.numbers["flights"]["worst"].items():
        stored = pq.read_table(
            low.out / "histories", filters=[("controller", "=", name)], partitioning=None
        )["flight"]
        assert {entry["flight"] for entry in listed} == set(stored.to_pylist()) and len(
            listed
        ) == 20
        values = [entry["metrics"][LOW] for entry in listed]
        assert values == sorted(values)
    assert low.numbers["flights"]["worst"]["one"][0]["flight"] == low.one[LOW].argmin()


def test_the_folder_says_what_is_bad_and_a_gate_takes_it_on_its_bad_side(low):
    schema = pq.read_schema(next(iter((low.out / "flights").glob("*.parquet"))))
    metadata = schema.field(LOW).metadata
    assert (
        metadata[b"bad"] == b"low"
        and metadata[b"unit"] == b"deg"
        and metadata[b"label"] == b"Angle of attack, min"
    )
    assert b"bad" not in schema.field(END_TIME.name).metadata
    for crossed, is_shown in ((("two", "one"), True), (("one", "two"), False)):
        (pair,) = compare(low.out, low.out, crossed, {LOW: 1e-6}).numbers()["paired"]
        assert pair["not_worse"][LOW]["shown"] is is_shown


def test_a_requirement_rules_the_side_of_a_declared_metric(tmp_path):
    declared = {"metrics": "{altitude_low_m: {of: altitude_m, statistic: min}}"}
    requirements = "[{metric: altitude_low_m, below: 20100 m, probability: 0.9}]"
    campaign = read_campaign(write_campaign(tmp_path, requirements=requirements, **declared))
    assert campaign.metrics["altitude_low_m"].bad == "high" and campaign.criteria[0].bad == "high"


def test_margins_are_no_rare_event(tmp_path):
    """Many flights share the values at both ends, where levels cannot grow."""
    requirements = "[{metric: gain_margin_min_db, above: 6, probability: 0.9}]"
    path = write_campaign(tmp_path, requirements=requirements, margins="{at: [trim], flights: all}")
    with pytest.raises(InputError, match=r"'gain_margin_min_db'.* 0 .*\b60 "):
        find_rare(RareRequest(path, tmp_path / "out", "gain_margin_min_db"), ENGINE)


def test_whoever_is_on_either_side_of_the_band_fails(band):
    (entry,) = json.loads((band.out / "manifest.json").read_text("utf-8"))["requirements"]
    assert (entry["above"], entry["below"], entry["failures"]) == (
        LEAST,
        MOST,
        int((band.outside >= 0.0).sum()),
    )
    with (band.out / "verification_matrix.csv").open(newline="") as file:
        row = next(csv.DictReader(file))
    assert (row["above"], row["below"], row["failures"]) == ("0.4", "2.3", str(entry["failures"]))


def test_the_report_ranks_and_bounds_by_the_distance_outside(band):
    (entry,) = band.numbers["verdicts"]["requirements"]
    verdict, worst_first = entry["controllers"]["one"], np.sort(band.outside)[::-1]
    assert "between 0.4 and 2.3" in entry["words"]
    assert verdict["tolerance_limit"] == pytest.approx(
        worst_first[most_failures(len(worst_first), 0.5, 0.1)]
    )
    assert verdict["room"] == pytest.approx(-verdict["tolerance_limit"] / 0.95)
    cell = band.numbers["verdicts"]["glance"][0]["cells"]["one"]
    assert cell["median"] == pytest.approx(np.percentile(band.outside, 50.0, method="nearest"))
    listed = [item["flight"] for item in band.numbers["flights"]["worst"]["one"]]
    assert band.outside[listed].tolist() == worst_first[:20].tolist()
    assert not list(verify_campaign(band.out))
