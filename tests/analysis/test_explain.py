"""Explanations and maps of failing flights of a fake campaign."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_flight import ENGINE, LOST_BELOW, fly, run, write_campaign
from report.synthetic import build_page

from abhv_mc.analysis.explain import Failure, explain_flight, mildest_first
from abhv_mc.analysis.failure_map import MOST_FLIGHTS, map_failures, read_map, write_map
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import read_manifest
from abhv_mc.io.messages import InputError
from abhv_mc.report.pages.build import is_up_to_date
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.topics.flights.model import rank_failed
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX

LIMIT = 4.9


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("explain")
    requirements = (
        f"[{{metric: altitude_error_max_m, below: {LIMIT}, probability: 0.9, "
        f"ended_early: as_measured}}]"
    )
    run(write_campaign(folder / "f", requirements=requirements), folder / "out")
    return folder / "out"


@pytest.fixture(scope="module")
def table(flown):
    return (
        pq.read_table(flown / "flights")
        .to_pandas()
        .query("controller == 'two'")
        .set_index("flight")
    )


def test_an_early_end_is_explained_by_the_density(flown, table):
    flight = int(table.query("outcome != 'ok'").index[0])
    explanation = explain_flight(flown, "two", flight, fly)
    assert (
        explanation.causes == ("atmosphere.density",)
        and explanation.smallest
        and not explanation.others
    )
    assert (
        explanation.failure.words == "ended early"
        and explanation.samples["atmosphere.density"] < LOST_BELOW
    )
    nominal, alone, dispersed = (
        dict(zip(explanation.samples, row, strict=True)) for row in explanation.rows
    )
    assert (
        alone == nominal | {"atmosphere.density": dispersed["atmosphere.density"]}
        and dispersed == explanation.samples
    )
    assert len(repr(explanation)) < 2000
    assert explanation.block.history.shape[0] == 3 and list(explanation.block.outcome) == [0, 3, 3]


def test_a_missed_requirement_is_explained_by_what_it_takes(flown, table):
    missed = table.query("outcome == 'ok' and altitude_error_max_m >= @LIMIT")
    sizes = set()
    for flight in missed.index[:30]:
        explanation = explain_flight(flown, "two", int(flight), fly, "altitude_error_max_m")
        alone = explanation.block.metrics[1, METRIC_INDEX["altitude_error_max_m"]]
        assert alone >= LIMIT > explanation.block.metrics[0, METRIC_INDEX["altitude_error_max_m"]]
        sizes.add(len(explanation.causes))
    assert sizes == {1, 2}


def test_the_earliest_end_is_the_most_severe():
    end = np.array([60.0, 10.0, 20.0])
    severity = Failure(None).severity(np.array([0, 3, 3]), end, end[:, None])
    assert severity.tolist() == [-np.inf, -10.0, -20.0]


def test_an_unknown_is_a_cause_like_a_dispersion(tmp_path):
    """Regression: 'the nominal flight fails, too' at a point where all other flights fail."""
    entries = {
        "unknowns": "{atmosphere.density: {low: 0.88, high: 1.1}}",
        "dispersions": "{aero.lift: {distribution: normal, sigma: 5 %}}",
    }
    folder = run(write_campaign(tmp_path / "f", runs="5", **entries), tmp_path / "out").folder
    flights = (
        pq.read_table(folder / "flights")
        .to_pandas()
        .query("controller == 'two' and outcome != 'ok'")
    )
    explanation = explain_flight(folder, "two", int(flights["flight"].iloc[0]), fly)
    assert (
        explanation.causes == ("atmosphere.density",)
        and explanation.samples["atmosphere.density"] < LOST_BELOW
    )
    assert list(explanation.block.outcome) == [0, 3, 3]


def test_what_cannot_be_explained_is_refused(flown, table):
    good = int(table.query("outcome == 'ok' and altitude_error_max_m < @LIMIT").index[0])
    lost = int(table.query("outcome != 'ok'").index[0])
    for message, arguments in {
        rf"\b{good}\b.*\btwo\b": ("two", good),
        r"\b300\b": ("two", 300),
        "'three'": ("three", 1),
        "'/x'": ("/x", 1),  # no path of a plan
        "^--requirement: .*'bank_deg'": ("two", lost, fly, "bank_deg"),
    }.items():
        name, flight, *options = arguments
        with pytest.raises(InputError, match=message):
            explain_flight(flown, name, flight, *(options or [fly]))

    def tame(plan, parameters, every=None):
        block = fly(plan, parameters, every)
        return replace(block, outcome=np.zeros_like(block.outcome))

    with pytest.raises(InputError, match=rf"\b{lost}\b.*manifest\.json"):
        explain_flight(flown, "two", lost, tame)


@pytest.mark.usefixtures("fake_engine")
def test_the_command_prints_the_causes_and_draws_the_flight(flown, table, tmp_path, abhv_mc):
    flight = int(table.query("outcome != 'ok'").index[0])
    code, output, _ = abhv_mc(f"explain {flown} --flight {flight} --controller two")
    assert code == 0 and re.search(r"\b1\D+2\b", output) and "atmosphere.density" in output
    assert (flown / f"explained/two-{flight}.png").stat().st_size > 10_000
    numbers = json.loads(
        abhv_mc(f"explain {flown} --flight {flight} --json - -o {tmp_path / 'x.png'}")[1]
    )
    assert numbers["controller"] == "one" and list(numbers["causes"]) == ["atmosphere.density"]
    assert numbers["smallest"]
    assert (tmp_path / "x.png").is_file()


def test_a_failure_that_seldom_comes_is_no_usual_dispersion():
    """Regression: a rare failure was the most usual one, with a warning of numpy."""
    drawn = np.column_stack(
        [np.where(np.arange(100) % 10, np.inf, 5.0), np.linspace(-1.0, 1.0, 100)]
    )
    samples = SimpleNamespace(flights=100, rows=lambda first, stop: drawn[first:stop])
    with np.errstate(all="raise"):
        assert mildest_first(samples, np.array([5.0, 0.8])).tolist() == [1, 0]
        assert mildest_first(samples, np.array([np.inf, 0.8])).tolist() == [0, 1]


@pytest.fixture(scope="module")
def mapped(flown):
    results = read_flown(flown)
    failed = {name: rank_failed(results, name) for name in results.controllers}
    return failed, map_failures(flown, failed, ENGINE)


def test_the_worst_failed_flights_are_mapped_each_once(flown, mapped):
    failed, failure_map = mapped
    table = pq.read_table(flown / "flights").to_pandas().set_index(["controller", "flight"])
    for name, controller_map in failure_map.controllers.items():
        early = (
            table.loc[name].query("outcome != 'ok'").sort_values("end_time_s", kind="stable").index
        )
        assert list(early) == failed[name][: len(early)]  # as the report ranks them
        grouped = [flight for group in controller_map.groups for flight in group.flights]
        assert sorted([*grouped, *controller_map.nominal, *controller_map.unexplained]) == sorted(
            failed[name][:MOST_FLIGHTS]
        )
        assert controller_map.failed == len(failed[name]) and controller_map.looked_at == min(
            controller_map.failed, MOST_FLIGHTS
        )


def test_an_early_end_is_the_low_density_and_nothing_else(flown, mapped):
    samples = (
        pq.read_table(flown / "samples.parquet")
        .to_pandas()
        .set_index("flight")["atmosphere.density"]
    )
    for controller_map in mapped[1].controllers.values():
        (group,) = [group for group in controller_map.groups if group.failure == "ended early"]
        (density,) = group.dispersions
        assert density.parameter == "atmosphere.density" and not density.high
        values = samples.loc[list(group.flights)]
        ends = (values.min(), values.median(), values.max())
        assert (density.least, density.median, density.largest) == pytest.approx(ends, rel=1e-12)
        assert density.largest < LOST_BELOW


def test_a_map_is_kept_for_its_flights_alone(flown, mapped):
    digest = read_manifest(CampaignFolder(flown).manifest).digest
    path = write_map(flown, mapped[1])
    assert read_map(flown, digest) == mapped[1] and read_map(flown, "another") is None
    text = path.read_text("utf-8")
    path.write_text(text.replace('"failed"', '"broken"'), "utf-8")
    with pytest.raises(InputError, match="explain"):
        read_map(flown, digest)
    path.unlink()
    assert read_map(flown, digest) is None


@pytest.mark.thorough
@pytest.mark.usefixtures("fake_engine")
def test_the_command_keeps_it_and_the_report_shows_it(flown, abhv_mc):
    build_page(flown)
    assert is_up_to_date(flown)
    code, output, _ = abhv_mc(f"explain {flown} --all --json -")
    assert code == 0 and not is_up_to_date(flown)
    assert not list(verify_campaign(flown))  # the map does not make the older report wrong
    numbers = json.loads(output)
    page = build_page(flown).read_text("utf-8")
    assert json.loads((flown / "report.json").read_text("utf-8"))["failures"]["map"] == numbers
    flight = numbers["two"]["groups"][0]["flights"][0]
    assert "density low" in page and "--controller two --flight NUMBER</code>" in page
    assert f'data-show="two {flight}"' in page
    assert "density low" in abhv_mc(f"explain {flown} --all --controller two")[1]
    assert list(
        json.loads((flown / "explained/failures.json").read_text("utf-8"))["controllers"]
    ) == ["two"]
    for wrong in (["--all", "--flight", "1"], [], ["--all", "--controller", "three"]):
        assert abhv_mc("explain", flown, *wrong)[0] == 2
