"""A campaign that asks for a metric of its own, whose small values are bad: it heads the answer, and rules the rest."""

import json

import pyarrow.parquet as pq
import pytest
from fake_flight import run
from report.synthetic import build_with

from abhv_mc.api import compare
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.folder.flights import END_TIME
from abhv_mc.io.input_error import InputError
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.search.rare import RareSettings, find_rare
from abhv_mc.search.search_flights import SearchRequest

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
