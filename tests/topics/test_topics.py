"""Topics of a campaign with planted failures and drivers, and a custom topic."""

import copy
import importlib.util
import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from golden import compare_report
from jsonschema import Draft202012Validator
from programs import invoke
from report.synthetic import build_page, write_campaign

import abhv_mc
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.messages import InputError
from abhv_mc.report.numbers.report_numbers import report_schema
from abhv_mc.report.pages.verify import skipped_topics, verify_campaign
from abhv_mc.statistics import judge
from abhv_mc.topics import Topic, register
from abhv_mc.topics.failure_cases.figures import still_flying
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.flights.figures import worst_channels
from abhv_mc.topics.flights.model import worst_flights
from abhv_mc.topics.formatting import json_data, significant
from abhv_mc.topics.metrics import METRICS, metric_statistics
from abhv_mc.topics.missed_requirements import requirement_failures
from abhv_mc.topics.registry import BUILT_IN, all_topics, find_topic
from abhv_mc.topics.topic import (
    REGISTERED,
    Cell,
    Models,
    Table,
    interval_cell,
    names_of,
    user_topics,
)
from abhv_mc.topics.verdicts import VERDICTS


def test_quantiles_count_failed_flights_as_worst(failing):
    table = Models(failing)[METRICS].table
    quantiles = {
        name: entry.quantiles for name, entry in table["altitude_error_max_m"].controllers.items()
    }
    values = failing.flights["tlc"].metrics["altitude_error_max_m"]
    assert quantiles["tlc"]["q95"].value == pytest.approx(np.quantile(values, 0.95))
    assert np.isinf(quantiles["lqr"]["q95"].value)  # 12 of 100 failed
    assert np.isfinite(quantiles["lqr"]["q50"].value)
    values = failing.flights["tlc"].metrics[
        "angle_of_attack_min_deg"
    ]  # of which small ones are bad
    least = table["angle_of_attack_min_deg"].controllers["tlc"]
    assert least.worst == values.min() and least.quantiles["q95"].value == pytest.approx(
        np.quantile(values, 0.05)
    )


def test_a_flight_that_ended_early_misses_every_requirement(failing):
    altitude = Models(failing)[VERDICTS].requirements[0].controllers
    assert altitude["lqr"].failures == altitude["lqr"].ended_early == 12
    assert altitude["lqr"].status == judge(12, 100, 0.9973).status == "FAIL"
    assert altitude["tlc"].status == "NOT SHOWN"


def test_still_flying_is_kaplan_and_meiers_estimate():
    after = np.array([1.0, 2.0, 2.0, 3.0, 5.0])  # the third's and the last's missions were over
    lost = np.array([True, True, False, True, False])
    share = still_flying(after, lost, np.array([0.5, 1.0, 2.5, 4.0, 6.0]))
    assert share[:4] == pytest.approx([1.0, 0.8, 0.8 * 3 / 4, 0.8 * 3 / 4 * 1 / 2])
    assert np.isnan(share[4])
    everyone = still_flying(after[:2], lost[:2], np.array([0.0, 10.0]))
    assert everyone.tolist() == [1.0, 0.0]


def test_the_planted_driver_and_rule_are_found(failing_numbers):
    drivers = failing_numbers["drivers"]["controllers"]["lqr"]
    kinds = failing_numbers["failures"]["controllers"]["lqr"]
    early = next(kind for kind in kinds if kind["kind"] == "ended early")
    assert early["rules"][0]["conditions"][0]["parameter"] == "atmosphere.density"
    assert re.search(r"\bdensity above \+\d", early["rules"][0]["where"])
    speed = drivers["metrics"]["angle_of_attack_error_rms_deg"]["parameters"]
    assert {entry["parameter"] for entry in speed if entry["driver"]} >= {
        "atmosphere.density",
        "aero.lift",
    }


def test_dependent_designs_get_estimates(tmp_path):
    models = Models(read_flown(write_campaign(tmp_path / "c", runs=16, sampling="lhs")))
    assert {models[VERDICTS].statuses(name)[0] for name in models.names.controllers} == {"ESTIMATE"}
    assert json_data(models[FLIGHTS].counts["tlc"].failure_share) == {
        "value": 0.0,
        "low": None,
        "high": None,
    }


def test_a_report_is_valid_and_one_with_a_number_more_is_not(failing_numbers):
    schema = report_schema()
    Draft202012Validator.check_schema(schema)
    validator, numbers = Draft202012Validator(schema), copy.deepcopy(failing_numbers)
    assert list(validator.iter_errors(numbers)) == []
    numbers["flights"]["counts"]["lqr"]["more"] = 1
    assert not validator.is_valid(numbers)


def test_worst_flights_have_their_three_largest_dispersions_in_sigma(flown):
    """Regression: one narrow cell listed all 24 dispersions."""
    models = Models(flown(80))
    widths = {"atmosphere.density": 0.1, "aero.lift": 0.1, "aero.drag": 0.15}
    samples = models.results.samples
    for entry in (entry for flights in models[FLIGHTS].worst.values() for entry in flights):
        sigmas = [abs(dispersion.sigma) for dispersion in entry.largest]
        assert len(sigmas) <= 3 and sigmas == sorted(sigmas, reverse=True)
        for dispersion in entry.largest:
            column = samples[dispersion.parameter]
            assert dispersion.sigma == pytest.approx(
                (dispersion.value - column.mean()) / column.std()
            )
            assert abs(dispersion.value - 1.0) <= widths[dispersion.parameter]
    table = next(
        table for table in models.section(FLIGHTS).tables() if table.title.startswith("Worst")
    )
    assert table.plain_rows()[0][-1].count(" sigma)") == 3


def test_a_settled_error_of_a_flight_lost_before_anything_settled_is_none(flown, monkeypatch):
    """Regression: the table of the worst flights showed 0, the best value."""
    results = flown(80)
    flights = results.flights["tlc"]
    metric = next(name for name in flights.metrics if flights.records[name].settled)
    values = np.zeros(flights.flight.size)
    values[::2] = 1.5
    monkeypatch.setattr(Experiment, "asked", (metric,))

    def found(outcome):
        flight_record = replace(
            flights,
            metrics={**flights.metrics, metric: values},
            outcome=np.full(values.size, outcome),
        )
        (entries, *_) = worst_flights(replace(results, flights={"tlc": flight_record})).values()
        return {(entry.flight % 2, entry.metrics[metric]) for entry in entries}

    assert found(Outcome.OK) <= {(0, 1.5), (1, 0.0)}
    lost = found(Outcome.BANK_LIMIT)
    assert (0, 1.5) in lost and {number % 2 for number, value in lost if np.isnan(value)} == {1}


def test_worst_flights_show_every_required_metric_and_how_many_are_missed(flown):
    """Regression: one required metric was missing, and a flight at 250 % of a limit was 'ok'."""
    results = flown(80)
    models = Models(results)
    required = results.campaign.requirements
    for name, worst in models[FLIGHTS].worst.items():
        flights = results.flights[name]
        failed = [requirement_failures(flights, item) for item in required]
        for flight in worst:
            row = np.flatnonzero(flights.flight == flight.flight)[0]
            assert flight.missed == sum(mask[row] for mask in failed)
    tables = [t for t in models.section(FLIGHTS).tables() if t.title.startswith("Worst")]
    for table in tables:
        heads = (*table.heads, table.caption)
        assert all(
            any(results.campaign.metrics[item.metric].label in text for text in heads)
            for item in required
        )
        assert "ok" not in [row[1] for row in table.plain_rows()]


def test_the_worst_flights_are_drawn_in_what_they_are_worst_in(flown):
    """Regression: four channels were fixed, but all listed flights were worst in speed."""
    results = flown(80)
    models = Models(results)
    recorded = {channel.name for channel in results.campaign.channels}
    worst = [flight.by for own in models[FLIGHTS].worst.values() for flight in own]
    drawn = worst_channels(models[FLIGHTS], models.names, recorded)
    assert set(drawn) == {results.campaign.metrics[metric].of for metric in worst}
    (first, critical), (text, figure) = models.figures(FLIGHTS)
    assert (first.name, text.name) == ("critical_errors", "worst_flights")
    lines = [[line.get_xydata() for line in axes.lines] for axes in critical.axes]
    assert [len(curves) for curves in lines] == [3, 3, 3, 0]  # an error and its two limits
    labels = [axes.get_ylabel() for axes in figure.axes if axes.get_ylabel()]
    assert len(labels) == len(drawn[:4])


EXAMPLE = Path(__file__).parents[2] / "docs/how-to/correlate.py"


@pytest.fixture
def topic():
    spec = importlib.util.spec_from_file_location("correlate", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    register(module.CORRELATE)
    yield module.CORRELATE
    REGISTERED.clear()


def test_it_stands_everywhere(topic, tmp_path):
    folder = write_campaign(tmp_path / "c", runs=40)
    page = build_page(folder).read_text("utf-8")
    assert (
        '<section id="correlate"' in page and '<a href="#correlate">Rank correlations</a>' in page
    )
    stored = json.loads((folder / "report.json").read_text("utf-8"))["topics"]["correlate"][
        "controllers"
    ]
    controllers = abhv_mc.open_results(folder).correlate.controllers
    assert (
        controllers["lqr"]["sideslip_max_deg"]["aero.lift"]
        == stored["lqr"]["sideslip_max_deg"]["aero.lift"]
        > 0.3
    )
    printed = invoke(f"show correlate {folder}")
    assert printed.exit_code == 0 and "Speed error, max" in printed.stdout
    assert list(verify_campaign(folder)) == []
    REGISTERED.clear()
    assert list(verify_campaign(folder)) == [] and skipped_topics(folder) == ["correlate"]


def test_one_that_raises_is_left_out_and_named(topic, tmp_path, capsys):
    register(Topic("broken", topic.model, lambda results: 1 / 0, topic.section))
    folder = write_campaign(tmp_path / "c", runs=40)
    build_page(folder)
    assert list(json.loads((folder / "report.json").read_text("utf-8"))["topics"]) == ["correlate"]
    errors = capsys.readouterr().err
    assert len(re.findall(r"(?m)\bbroken\b.*:$", errors)) == errors.count("ZeroDivisionError:") == 1


@pytest.mark.parametrize(("name", "message"), [("margins", "built-in"), ("x-y", "Python name")])
def test_a_name_that_it_cannot_have_is_refused(topic, name, message):
    with pytest.raises(InputError, match=message):
        register(Topic(name, topic.model, topic.compute, topic.section))


def test_the_numbers_and_curves_of_a_report_are_the_stored_ones(tmp_path):
    assert not compare_report("sections", tmp_path)


def test_constant_columns_move_to_the_caption():
    rows = tuple(
        (Cell(name, head=True), Cell("7"), Cell(text)) for name, text in (("a", "1"), ("b", "2"))
    )
    table = Table("T", ("Name", "Same", "Different"), (rows,), "C").without_constant()
    assert table.heads == ("Name", "Different")
    assert table.plain_rows() == [["a", "1"], ["b", "2"]]
    assert table.caption.startswith("C") and table.caption.endswith("Same: 7")
    varying = Table("T", ("Name", "Different"), (tuple((r[0], r[2]) for r in rows),), "C")
    assert varying.without_constant() == varying
    single = Table("T", ("Name", "Same"), ((rows[0][:2],),), "C")
    assert single.without_constant() == single


def test_topics_are_in_the_order_of_the_page_and_found_by_name(topic):
    names = [item.name for item in all_topics()]
    own = [item.name for item in BUILT_IN]
    assert names == [*own[:-2], "correlate", *own[-2:]] and own[-1] == "provenance"
    assert [item.name for item in all_topics(())] == own
    assert find_topic("correlate") is topic and find_topic("verdicts") is VERDICTS
    with pytest.raises(InputError):
        find_topic("nothing")


def test_entry_points_are_topics_or_say_why_not(topic, monkeypatch, capsys):
    """A registered topic replaces an installed one of its name."""
    entries = {
        "good": SimpleNamespace(name="good", load=lambda: replace(topic, name="good")),
        "same": SimpleNamespace(name="same", load=lambda: replace(topic, section=None)),
        "broken": SimpleNamespace(name="broken", load=lambda: 1 / 0),
    }
    monkeypatch.setattr("abhv_mc.topics.topic.find_entry_points", lambda _: entries)
    found = user_topics()
    assert [item.name for item in found] == ["good", "correlate"] and found[1] is topic
    assert "ZeroDivisionError" in capsys.readouterr().err
    entries["bad"] = SimpleNamespace(name="bad", load=lambda: 3)
    with pytest.raises(InputError, match="bad"):
        user_topics()


def test_printed_commands_have_the_folder_relative_to_the_page(flown):
    results = flown(80)
    assert names_of(results).folder == results.folder.as_posix()
    page = results.folder.parent / "pages"
    assert names_of(results, page).folder == f"../{results.folder.name}"
    spaced = replace(results, folder=page / "my run")
    names = names_of(spaced, page)
    assert names.folder == "'my run'" and names.kind == "Controller"
    assert (names.label("tlc"), names.label("unknown")) == ("TLC", "unknown")


@pytest.mark.parametrize(
    ("bad", "worst", "flight"), [("high", 8.0, 14), ("low", -9.0, 12), ("size", -9.0, 12)]
)
def test_the_worst_value_is_of_a_completed_flight(flown, bad, worst, flight):
    """Flights 11 and 15 are lost, and flight 13 has no value."""
    results, metric = flown(80), "sideslip_max_deg"
    values = np.array([1.0, 30.0, -9.0, np.nan, 8.0, -30.0])
    outcome = np.array([0, 3, 0, 0, 0, 3])
    record = replace(results.campaign.metrics[metric], bad=bad)
    flights = replace(
        results.flights["tlc"], flight=np.arange(10, 16), outcome=outcome, metrics={metric: values}
    )
    entry = metric_statistics(flights, metric, record)
    assert (entry.worst, entry.worst_flight) == (worst, flight)
    assert np.isinf(entry.quantiles["q95"].value)
    assert (entry.quantiles["q95"].value > 0) is (bad != "low")
    lost = metric_statistics(replace(flights, outcome=np.full(6, 3)), metric, record)
    assert (lost.worst, lost.worst_flight) == (None, None)


def test_required_metrics_are_listed_first_and_equal_ones_once(flown):
    """Metrics that exclude transients are left out where these make no difference."""
    results = flown(80)
    settled, plain = "bank_error_settled_max_deg", "bank_error_max_deg"
    flights = {
        name: replace(own, metrics={**own.metrics, settled: own.metrics[plain]})
        for name, own in results.flights.items()
    }
    models = Models(replace(results, flights=flights))
    found = models[METRICS]
    assert found.table[settled].same_as == plain and found.table[plain].same_as is None
    other = {**flights["lqr"].metrics, settled: 1.0 + flights["lqr"].metrics[plain]}
    changed = {**flights, "lqr": replace(flights["lqr"], metrics=other)}
    assert Models(replace(results, flights=changed))[METRICS].table[settled].same_as is None
    tables = models.section(METRICS).tables()
    labels = [[row[0].partition(" (")[0] for row in table.plain_rows()[::3]] for table in tables]
    asked = [found.table[name].words["label"] for name in found.asked]
    assert labels[0] == asked
    listed = [label for own in labels for label in own]
    assert "Bank error from own command, max" in listed
    assert "Bank error from own command, settled, max" not in listed
    assert len({*listed}) == len(listed) == sum(not entry.same_as for entry in found.table.values())
    row = tables[0].plain_rows()[0]
    entry = found.table[found.asked[0]].controllers["tlc"]
    assert row[1] == "TLC" and row[-1] == str(entry.worst_flight)
    assert row[-2] == significant(entry.worst, 4)
    quantiles = [interval_cell(interval).plain for interval in entry.quantiles.values()]
    assert row[2:-2] == quantiles
