"""A Saltelli campaign from the file to the page: indices where all flew, reasons where not."""

import json

import pytest
from fake_flight import ENGINE, write_campaign
from report.few_figures import build_with

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution.runner import run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder.results import read_results
from abhv_mc.io.documents import InputError
from abhv_mc.report.numbers.report_numbers import make_numbers
from abhv_mc.report.numbers.summary import summary_sentences
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.topics.topic import Models

LAWS = (
    "{atmosphere.density: {distribution: uniform, half_width: %s},"
    " aero.lift: {distribution: uniform, half_width: 1 %%}, aero.drag: {distribution: uniform, half_width: 1 %%}}"
)


def fly(folder, half_width="5 %", runs=640):
    files = write_campaign(folder / "f", sampling="saltelli", runs=str(runs), dispersions=LAWS % half_width)
    return run_campaign(Request(files, folder / "out"), ENGINE).folder


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = fly(tmp_path_factory.mktemp("saltelli"))
    build_with(folder)
    return folder


def test_the_report_names_what_causes_the_variance(flown):
    numbers = json.loads((flown / "report.json").read_text(encoding="utf-8"))
    part = numbers["sobol"]["controllers"]["one"]
    assert part["refused"] is None and numbers["sobol"]["group"] == 5
    top, *rest = part["metrics"]["fuel_used_kg"]
    assert top["parameter"] == "atmosphere.density" and top["first"][0] > 0.9
    assert all(entry["total"][0] < 0.2 for entry in rest)
    page = (flown / "report.html").read_text(encoding="utf-8")
    assert "Sobol indices of the errors, largest total first" in page
    first, second, *_ = summary_sentences(Models(read_results(flown)), numbers)
    assert first.startswith("What spreads an error most is for one and two the same in ")
    assert second.startswith("What moves the errors of one most (share of the variance that involves them, within ")
    assert "density (" in second
    assert {entry["controllers"]["one"]["status"] for entry in numbers["requirements"]} == {"ESTIMATE"}
    assert list(verify_campaign(flown)) == []


def test_indices_within_noise_are_not_told(flown):
    """144 flights said 'density (34 %, 59 % alone), within 118 % or closer', and what spreads an error most."""
    numbers = json.loads((flown / "report.json").read_text(encoding="utf-8"))
    for part in numbers["sobol"]["controllers"].values():
        for entries in part["metrics"].values():
            for entry, total in zip(entries, (0.6, 0.5, 0.1), strict=True):
                entry["total"], entry["first"] = [total, total - 0.4, total + 0.4], [0.7, 0.4, 1.0]
    first, second, *_ = summary_sentences(Models(read_results(flown)), numbers)
    assert first.startswith("What spreads an error most is for one and two open in max altitude error")
    assert "too few flights to share out" in second and "alone" not in second and "within" not in second
    for part in numbers["sobol"]["controllers"].values():
        for entries in part["metrics"].values():
            for entry, total in zip(entries, (0.6, 0.3, 0.1), strict=True):
                entry["total"], entry["first"] = [total, total - 0.1, total + 0.1], [0.7, 0.6, 0.8]
    first, second, *_ = summary_sentences(Models(read_results(flown)), numbers)
    assert first.startswith("What spreads an error most is for one and two the same in ")
    assert "(60\u202f%, 60\u202f% alone)" in second and "within 10\u202f% or closer" in second


def test_failed_flights_are_refused_by_name(tmp_path):
    numbers = make_numbers(Models(read_results(fly(tmp_path, "10 %"))))
    part = numbers["sobol"]["controllers"]["two"]
    assert part["metrics"] == {} and "of 640 flights ended early" in part["refused"]


def test_rules_and_ranks_use_flights_that_share_nothing(tmp_path):
    numbers = make_numbers(Models(read_results(fly(tmp_path, "10 %"))))
    (kind, *_) = numbers["drivers"]["controllers"]["one"]["failures"]
    assert kind["flights"] == 640 and kind["rules"][0]["others"] + kind["rules"][0]["failures"] == 2 * 128


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        (dict(runs="641"), "641; expected a multiple of 5 (parameters + 2)"),
        (dict(correlations="[{between: [aero.drag, aero.lift], rank: 0.2}]"), "need independent parameters"),
        (dict(dispersions="{}"), "'saltelli' without dispersions"),
    ],
)
def test_what_gives_no_indices_is_refused(tmp_path, entries, words):
    entries = {"sampling": "saltelli", "runs": "640", "dispersions": LAWS % "5 %", **entries}
    with pytest.raises(InputError) as caught:
        read_campaign(write_campaign(tmp_path, **entries))
    assert words in str(caught.value)
