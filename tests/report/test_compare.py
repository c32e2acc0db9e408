"""Paired comparisons: numbers, gate, page, and the baseline on a report's first screen."""

import html
import json
import re
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from report.synthetic import build_page, write_campaign

from abhv_mc.api import compare
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.unknowns import Unknowns
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.messages import InputError
from abhv_mc.report.numbers.compare import (
    _gate,
    check_baseline,
    gate_text,
    pair_campaigns,
    parse_margins,
    require_same_samples,
)
from abhv_mc.report.pages import compare_page
from abhv_mc.report.pages.build import is_up_to_date
from abhv_mc.report.pages.compare_page import _folder_names, _pair_texts, _source
from abhv_mc.report.pages.verify import verify_campaign
from abhv_mc.statistics.gate import Gate
from abhv_mc.topics.comparison.model import metric_differences
from abhv_mc.topics.formatting import percent
from abhv_mc.topics.topic import Fold, Picture
from abhv_mc_vehicle.flight.metrics import METRICS

METRIC_RECORDS = {metric.name: metric for metric in METRICS}


def test_controllers_can_be_crossed(failing_folder, failing_numbers):
    comparison = compare(failing_folder, failing_folder, ("lqr", "tlc"))
    (pair,) = comparison.numbers()["paired"]
    entry = pair["metrics"]["speed_error_max_mps"]
    shares = (percent(entry[f"{side}_better"] / pair["pairs"], 2) for side in "ab")
    lines = [record.line for record in comparison.section.items[0].records]
    assert f"speed error (better on {' / '.join(shares)}" in " ".join(lines)
    inside = failing_numbers["comparison"]["pairs"]["lqr - tlc"]
    assert pair["requirements"] == inside["requirements"]
    metric = "sideslip_max_deg"
    assert (
        pair["metrics"][metric]["quantile_differences"]
        == inside["metrics"][metric]["quantile_differences"]
    )


def test_a_controller_that_loses_more_flights_fails_whatever_its_metric(failing_folder):
    margins = parse_margins(["speed_error_max_mps=900 %"])
    (pair,) = compare(failing_folder, failing_folder, ("tlc", "lqr"), margins).numbers()["paired"]
    gate = pair["not_worse"]["speed_error_max_mps"]
    assert gate["loses_more"] and not gate["shown"]


@pytest.mark.parametrize(("crossed", "margin", "code", "sentence"), [
    ("lqr,lqr_retuned", "5%", 0, " passed; "),
    ("lqr_retuned,lqr", "5%", 1, " not passed; "),
    ("lqr_retuned,lqr", "500%", 1, "more violations of Speed error"),
])  # fmt: skip
def test_the_gate_is_the_exit_code(failing_folder, abhv_mc, crossed, margin, code, sentence):
    """Continuous integration uses the exit code to reject a change that worsens a metric."""
    gate = ["--controllers", crossed, "--fail-if-worse", f"bank_error_rms_deg={margin}"]
    status, out, _ = abhv_mc("compare", failing_folder, failing_folder, *gate)
    assert (status, sentence in " ".join(out.split())) == (code, True), out


@pytest.mark.parametrize("lost", [5, 6])
def test_the_points_of_the_unknowns_share_the_risk_of_the_gate(lost):
    """Of two points, each has a risk of 2.5 %; 5 and 6 newly lost flights have 3.1 and 1.6 %."""
    flight = np.arange(80)
    a = ControllerFlights(
        flight, np.zeros(80, np.uint8), {"speed_error_max_mps": 1.0 + flight}, (), METRIC_RECORDS
    )
    b = replace(a, outcome=np.where((flight < 2 * lost) & (flight % 2 == 0), Outcome.FUEL_OUT, 0))
    points = Unknowns(points=np.zeros((2, 0)))
    assert _gate(a, b, "speed_error_max_mps", 0.05, (), unknowns=points).loses_more == (lost == 6)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"controllers": ("tlc", "pid")}, "pid"),
    ({"controllers": ("tlc",)}, "two"),
    ({"fail_if_worse": {"no_metric": 0.05}}, "unknown metric 'no_metric'"),
])  # fmt: skip
def test_what_cannot_be_compared_is_refused(failing_folder, arguments, message):
    with pytest.raises(InputError, match=message):
        compare(failing_folder, failing_folder, **arguments)


@pytest.fixture(scope="module")
def before(tmp_path_factory):
    return write_campaign(
        tmp_path_factory.mktemp("pair") / "before", runs=40, failing=2, controllers=("tlc", "lqr")
    )


@pytest.fixture(scope="module")
def after(before):
    """Write a campaign on the same samples in which three more flights of LQR are lost."""
    return write_campaign(before.parent / "after", runs=40, failing=5, controllers=("tlc", "lqr"))


def newly_failed(before, after):
    """Return flights of LQR that fail in the second folder only.

    They terminate early or miss a requirement.
    """
    failed = []
    for folder in (before, after):
        lqr = read_flown(folder).flights["lqr"]
        limits = {"altitude_error_max_m": 50.0, "speed_error_max_mps": 5.0, "sideslip_max_deg": 0.7}
        missed = np.any([~(lqr.metrics[name] < limit) for name, limit in limits.items()], axis=0)
        failed.append(set(np.flatnonzero(missed | lqr.failed).tolist()))
    assert failed[0] < failed[1]
    return failed[1] - failed[0]


def test_two_campaigns_make_a_page_with_every_flight_that_only_one_loses(
    before, after, abhv_mc, tmp_path
):
    gate = ["--fail-if-worse", "altitude_error_max_m=5%"]
    code, output, _ = abhv_mc(
        "compare", before, after, "-o", tmp_path / "page", "--controllers", "lqr,lqr", *gate
    )
    assert code == 0 and f"report    {tmp_path / 'page' / 'report.html'}" in output
    page = (tmp_path / "page/report.html").read_text("utf-8")
    lost = newly_failed(before, after)
    ended = np.sort(np.argsort(read_flown(after).samples["atmosphere.density"])[-5:-2]).tolist()
    assert (
        f"<td>{', '.join(map(str, ended))}</td>" in page
        and f"abhv-mc replay {after} --controller NAME" in page
    )
    assert lost <= set(ended)
    text = html.unescape(page)
    assert re.search(r"LQR: max altitude error, passed; ", text)
    assert f"before only 0, after only {len(lost)}, both" in text
    assert "Better" not in text.partition("<table")[0]
    assert f"abhv-mc explain {after} --all" in page and f"`abhv-mc explain {after} --all`" in output
    assert "<script" not in page and "http" not in page.replace("http-equiv", "").lower()


def test_differences_are_those_of_the_same_flight(before):
    results = read_flown(before)
    tlc, lqr = (results.flights[name] for name in ("tlc", "lqr"))
    differences = metric_differences(tlc, lqr, "speed_error_max_mps")
    completed = ~lqr.failed
    expected = tlc.metrics["speed_error_max_mps"] - lqr.metrics["speed_error_max_mps"]
    assert np.array_equal(differences[completed], expected[completed])
    assert np.isneginf(differences[~completed]).all() and (~completed).sum() == 2


@pytest.fixture(scope="module")
def with_baseline(before, after):
    build_page(after, baseline=before)
    return after


def test_the_first_screen_says_what_changed_against_the_baseline(with_baseline, before):
    lost = len(newly_failed(before, with_baseline))
    page = (with_baseline / "report.html").read_text("utf-8")
    records = html.unescape(page).partition("<dt>Compared with 'before'</dt>")[2]
    tlc, lqr = re.findall(r"<dd><strong>(\w+)</strong> [^<]* (\d+ / \d+) of 40", records)
    assert (tlc, lqr) == (("TLC", "0 / 0"), ("LQR", f"{lost} / 0"))
    numbers = json.loads((with_baseline / "report.json").read_text("utf-8"))["baseline"]
    assert numbers["folder"] == before.as_posix()
    assert [pair["any_failure"]["only_a"] for pair in numbers["paired"][:2]] == [0, lost]


def test_a_report_with_a_baseline_is_verified_with_it(with_baseline, before):
    assert list(verify_campaign(with_baseline)) == []
    assert is_up_to_date(with_baseline, baseline=before) and not is_up_to_date(with_baseline)
    report = with_baseline / "report.json"
    content = report.read_text("utf-8")
    numbers = json.loads(content)
    numbers["baseline"]["paired"][1]["any_failure"]["only_a"] = 0
    report.write_text(json.dumps(numbers), "utf-8")
    assert any("any_failure.only_a" in line for line in verify_campaign(with_baseline))
    numbers["baseline"]["folder"] = "no/such/folder"
    report.write_text(json.dumps(numbers), "utf-8")
    (line,) = verify_campaign(with_baseline)
    assert line.startswith("baseline: no/such/folder ")
    report.write_text(content, "utf-8")


def test_other_samples_are_refused_before_anything_flies(before, abhv_mc, tmp_path):
    write_campaign(tmp_path / "other", runs=10, seed=8, controllers=("tlc", "lqr"))
    campaign = tmp_path / "other files/campaign.yaml"
    with pytest.raises(InputError, match=r"'atmosphere\.density' is .*\b0\b"):
        check_baseline(read_campaign(campaign), before)
    code, _, err = abhv_mc("run", campaign, "-o", tmp_path / "out", "--baseline", before)
    assert code == 2 and "'atmosphere.density' is " in err and not (tmp_path / "out").exists()


GATE = """
simulator: {python: law.py, time_limit: 10 s}
systems: {law: {new: %d}}
inputs: {a: {unit: m, nominal: 0}, b: {unit: m, nominal: 0}, g: {unit: m, nominal: 0}}
unknowns: {a: {low: -1, high: 1}, b: {low: -1, high: 1}}
dispersions: {g: {distribution: normal, sigma: 1}}
metrics: {err: {unit: m, bad: high}}
requirements: [{metric: err, below: 12, probability: 90 %%, consumer_risk: 10 %%}]
name: gate
question: Is the new version worse?
runs: 40
seed: 1
"""
LAW = """
def fly(i, s):
    error = 3 - (i["a"] - (0.31 if s["new"] else 0.3)) ** 2 + 0.1 * i["b"] + 0.2 * i["g"]
    corner = s["new"] == 2 and min(i["a"], i["b"]) > 0.9
    lost = s["new"] == 2 and corner and i["g"] > 1.5
    return {"err": 1.9 * error if corner else error, **({"outcome": "crash"} if lost else {})}
"""


@pytest.fixture(scope="module")
def versions(tmp_path_factory):
    """Write campaign files of versions 0, 1 (another worst point) and 2 (worse at one corner)."""
    root = tmp_path_factory.mktemp("versions")
    (root / "law.py").write_text(LAW, "utf-8")
    for new in range(3):
        text = GATE % new + "outcomes: {crash: lost}\n"
        (root / f"{new}.yaml").write_text(text, "utf-8")
    return root


def test_campaigns_with_unknowns_pair_at_the_points_of_the_baseline(versions, abhv_mc, monkeypatch):
    """Regression: the worst points differ, so flights had other numbers and did not pair."""
    monkeypatch.setattr("abhv_mc.statistics.unknowns.FEWEST_SEARCHED", 8)

    def fly(new, *options):
        code, _, err = abhv_mc(
            "run", versions / f"{new}.yaml", "-o", versions / f"out{new}", "--trust-code", *options
        )
        assert code in (0, 1), err
        return read_flown(versions / f"out{new}")

    before = fly(0, "--no-report")
    points = before.campaign.unknowns.points
    for new in (1, 2):
        after = fly(new, "--baseline", versions / "out0")
        own_points = after.campaign.unknowns.points
        assert all(np.any(np.all(np.isclose(own_points, point), axis=1)) for point in points)
        assert after.campaign.unknowns.shared >= len(points)
    assert len(read_flown(versions / "out1").campaign.unknowns.points) > len(points)
    first, second = pair_campaigns(*(read_flown(versions / f"out{i}") for i in (0, 1)))
    assert len(first.campaign.unknowns.points) == len(points)
    flown = read_flown(versions / "out1")
    for k, number in enumerate(second.flights["law"].flight[:30].tolist()):
        sample, point = divmod(number, len(points))
        index = np.all(np.isclose(flown.campaign.unknowns.points, points[point]), axis=1).argmax()
        row = sample * len(flown.campaign.unknowns.points) + index
        metric = second.flights["law"].metrics["err"][k]
        assert metric == flown.flights["law"].metrics["err"][row]
        assert second.samples["g"][number] == flown.samples["g"][row] == first.samples["g"][number]
    gate = ("--fail-if-worse", "err=5%", "--fail-if-loses", "1")
    assert abhv_mc("compare", versions / "out0", versions / "out1", *gate)[0] == 0
    code, output, _ = abhv_mc("compare", versions / "out0", versions / "out2", *gate)
    text = " ".join(output.split())
    assert code == 1 and "unknowns a 1 m, b 1 m" in text and "not passed" in text
    lost = compare(versions / "out0", versions / "out2").numbers()["paired"][0]["newly_lost"]
    assert lost > 0 and f": {lost}\n" in output
    losing = ("compare", versions / "out0", versions / "out2", "--fail-if-loses")
    assert [abhv_mc(*losing, number)[0] for number in (lost, lost + 1)] == [1, 0]


@pytest.mark.parametrize(
    ("a", "b", "problem"),
    [
        ({"x": [1.0]}, {}, "no column 'x'"),
        ({}, {"x": [1.0]}, "additional column 'x'"),
        ({"x": [1.0, 2.0, 3.0]}, {"x": [1.0, 5.0]}, "'x' is 5.0 in flight 1.*2.0"),
        ({"x": [1.0, 2.0]}, {"x": [1.0, 2.0, 3.0]}, None),
    ],
)
def test_samples_must_be_equal_in_the_common_flights(a, b, problem):
    samples = [{name: np.array(own) for name, own in side.items()} for side in (a, b)]
    with pytest.raises(InputError, match=problem) if problem else nullcontext():
        require_same_samples(*samples, Path("a"), Path("b"))


def test_a_gate_says_how_it_ended():
    """Nothing stops the first; each of four reasons stops the second."""
    shown = Gate(0.05, 80, 70, 0.81, (), False, False, ())
    stopped = Gate(0.05, 80, 70, 0.81, (0.9973,), True, True, (1,), at="drag 1 m")
    metrics = {"m": SimpleNamespace(worst=(2.0, 5.0))}
    first, second = (
        gate_text(SimpleNamespace(not_worse={"m": gate}, metrics=metrics), "m", ["A", "B"])
        for gate in (shown, stopped)
    )
    assert re.findall(r"[\d.]+", first)[:5] == ["5", "70", "80", "81", "50"]
    assert first.startswith("passed; ") and first.count("; ") == 1
    reasons = second.split("; ")
    assert reasons[0] == "not passed" and reasons[2] == "unknowns drag 1 m"
    assert "99.73 %" in reasons[3] and "2.00 -> 5.00" in reasons[4] and len(reasons) == 7
    assert reasons[6].endswith(" B")


def test_the_gate_is_that_of_the_worst_point(before):
    """Sample k of two points p is flight 2 k + p: the second controller is worse at point 1."""
    a = read_flown(before).flights["tlc"]
    speed, at_second = "speed_error_max_mps", a.flight % 2 == 1
    b = replace(a, metrics={speed: a.metrics[speed] * np.where(at_second, 1.2, 1.0)})
    points = Unknowns(points=np.zeros((2, 0)))
    gate = _gate(a, b, speed, 0.1, (), unknowns=points)
    assert (gate.pairs, gate.within, gate.shown) == (20, 0, False)
    assert _gate(a, b, speed, 0.3, (), unknowns=points).within == 20


def test_the_table_of_sources_has_the_seed_of_flights_and_none_of_tables(tmp_path):
    a, b = (
        SimpleNamespace(
            folder=tmp_path / name,
            campaign=SimpleNamespace(seed=7, can_rerun=flies),
            manifest=SimpleNamespace(runs_done=1200, digest=f"digest {name}"),
        )
        for name, flies in (("a", True), ("b", False))
    )
    rows = _source(a, b, tmp_path / "out", ["--fail"]).plain_rows()
    assert [row[1] for row in rows] == ["7", "imported"]
    assert [row[3] for row in rows] == ["digest a", "digest b"]
    assert len(_source(a, a, tmp_path / "out", []).plain_rows()) == 1


def at_points(results, points, absent, g):
    """Return results of flights k p + i of sample k at point i, whose metric is their number."""
    total, runs = len(points), g.size
    flight = np.setdiff1d(np.arange(runs), absent)
    own = ControllerFlights(
        flight,
        np.where(flight % 5 == 0, Outcome.FUEL_OUT, Outcome.OK).astype(np.uint8),
        {"speed_error_max_mps": flight.astype(float)},
        np.array(absent, int),
        METRIC_RECORDS,
    )
    unknowns = Unknowns(names=("x",), points=np.array(points)[:, None], shared=1)
    samples = {"g": g, "x": np.resize(points, runs)}
    campaign = replace(results.campaign, unknowns=unknowns, runs=runs // total * total)
    return replace(results, campaign=campaign, samples=samples, flights={"tlc": own})


def test_flights_are_renumbered_at_the_common_points(before):
    """Of points 1, 2, 3 and points 3, 1, the points 1 and 3 are flights 2 k and 2 k + 1."""
    results, sample = read_flown(before), np.arange(4.0)
    a = at_points(results, [1.0, 2.0, 3.0], [4, 5], np.repeat(sample, 3))
    b = at_points(results, [3.0, 1.0], [6], np.repeat(sample, 2))
    a, b = pair_campaigns(a, b)
    for side, old, absent in ((a, [0, 2, 3, 6, 8, 9, 11], [3]), (b, [1, 0, 3, 2, 5, 4, 7], [7])):
        flights = side.flights["tlc"]
        kept = np.setdiff1d(np.arange(8), absent)
        assert flights.flight.tolist() == kept.tolist() and flights.absent.tolist() == absent
        assert flights.metrics["speed_error_max_mps"].tolist() == old
        assert flights.failed.tolist() == [number % 5 == 0 for number in old]
        assert side.campaign.unknowns.points.tolist() == [[1.0], [3.0]]
        assert side.campaign.unknowns.shared is None and side.campaign.runs == 8
        assert side.samples["g"].tolist() == np.repeat(sample, 2).tolist()
        assert side.samples["x"].tolist() == [1.0, 3.0] * 4


@pytest.mark.parametrize(
    ("points", "g", "names", "message"),
    [
        ([1.0, 2.0], 0.0, ("y",), "unknowns are 'y'"),
        ([1.0, 2.0], 0.0, (), "no unknowns"),
        ([1.0 + 1e-6, 4.0], 0.0, ("x",), "no common point"),
        ([1.0 + 1e-12, 4.0], 1.0, ("x",), "'g' is 1.0 in flight 0"),
    ],
)
def test_campaigns_without_a_common_point_are_refused(before, points, g, names, message):
    results = read_flown(before)
    a = at_points(results, [1.0, 2.0], [], np.zeros(4))
    b = at_points(results, points, [], np.full(4, g))
    unknowns = replace(b.campaign.unknowns, names=names)
    b = replace(b, campaign=replace(b.campaign, unknowns=unknowns))
    with pytest.raises(InputError, match=message):
        pair_campaigns(a, b)


def test_newly_lost_flights_are_those_of_the_second_campaign_only(before, after):
    counts = [
        {pair["controllers"][0]: pair["newly_lost"] for pair in compare(*both).numbers()["paired"]}
        for both in ((before, after), (after, before))
    ]
    assert counts == [{"tlc": 0, "lqr": 3}, {"tlc": 0, "lqr": 0}]
    (pair,) = compare(after, after, ("tlc", "lqr")).numbers()["paired"]
    assert pair["newly_lost"] == pair["ended_early"]["only_b"] == 5


def test_a_baseline_has_the_same_unknowns_and_a_common_controller(before):
    campaign = read_campaign(before.parent / "before files/campaign.yaml")
    check_baseline(campaign, before)
    others = write_campaign(before.parent / "others", runs=10, controllers=("pid",))
    with pytest.raises(InputError, match="'tlc' or 'lqr'"):
        check_baseline(read_campaign(others.parent / "others files/campaign.yaml"), before)
    changed = replace(campaign, unknowns=Unknowns(names=("x",)))
    with pytest.raises(InputError, match="unknowns differ"):
        check_baseline(changed, before)


def lines(section):
    return {
        record.label: [re.sub(r"\s", " ", entry.text) for entry in record.entries]
        for record in section.items[0].records
    }


def test_the_rows_of_a_paired_comparison_are_differences_of_the_same_flights(before, after):
    comparison = compare(before, after, ("tlc", "lqr"))
    (pair,) = comparison.found.paired
    table = comparison.table.set_index(["metric", "quantity"])
    assert len(table) == 4 * len(pair.metrics)
    assert set(zip(table["a"], table["b"], strict=True)) == {("tlc", "lqr")}
    assert np.isnan(table[["first", "second"]].to_numpy()).all()
    tlc, lqr = (
        read_flown(folder).flights[name] for folder, name in ((before, "tlc"), (after, "lqr"))
    )
    speed = "speed_error_max_mps"
    ends = table.loc[speed, "median over flights"][["difference", "low", "high"]].to_numpy()
    differences = np.where(lqr.failed, -np.inf, tlc.metrics[speed] - lqr.metrics[speed])
    assert float(ends[0]) == pytest.approx(np.median(differences)) and ends[1] <= ends[0] <= ends[2]
    for level, difference in pair.metrics[speed].quantile_differences.items():
        row = table.loc[speed, f"{level[1:]} % quantile"][["difference", "low", "high"]]
        np.testing.assert_equal(row.to_numpy(float), list(vars(difference).values()))


def test_identical_campaigns_have_neither_tables_nor_a_figure(before):
    comparison = compare(before, before)
    found = lines(comparison.section)
    assert found["Identical"] == ["TLC against TLC, 40 flights", "LQR against LQR, 40 flights"]
    assert [type(item) for item in comparison.section.items[1:]] == [Picture]
    assert len(found["Re-run a flight"]) == 1 and not {"Next", "Failed flights"} & found.keys()
    with pytest.raises(InputError, match="no metric differs"):
        comparison.figure()


@pytest.mark.parametrize(
    ("second", "controllers", "title", "failed"),
    [
        (False, ("tlc", "lqr"), "TLC against LQR", "TLC against LQR, 40 flights: TLC only 0, LQR"),
        (True, ("lqr", "lqr"), "before against after", "LQR, 40 flights: before only 0, after"),
        (True, ("tlc", "lqr"), "before against after",
         "before (TLC) against after (LQR), 40 flights: before (TLC) only 0, after (LQR)"),
    ],
)  # fmt: skip
def test_pairs_are_named_by_what_differs(
    before, after, monkeypatch, tmp_path, second, controllers, title, failed
):
    answers = []
    monkeypatch.setattr(compare_page, "write_answer", lambda *given: answers.append(given))
    other = after if second else before
    comparison = compare_page.compare_folders(before, other, controllers, out=tmp_path)
    ((answer, path),) = answers
    found = lines(comparison.section)
    assert (answer.title, path) == (title, tmp_path / "report.html")
    assert found["Failed flights"][0].startswith(failed) and len(found["Re-run a flight"]) == (
        1 + second
    )
    assert f"explain {other} --all`" in found["Next"][0]
    source = answer.section.items[-1]
    assert f"--controllers {','.join(controllers)}" in source.caption
    assert len(source.plain_rows()) == 1 + second
    content = json.loads((tmp_path / "comparison.json").read_text("utf-8"))
    digests = [read_flown(folder).manifest.digest for folder in (before, after)]
    assert content["digests"] == [digests[0], digests[second]]


def test_the_figure_shows_the_metrics_in_which_a_flight_differs(before, after, monkeypatch):
    calls = []
    monkeypatch.setattr(compare_page, "plot_differences", lambda *given: calls.append(given))
    compare(before, after).figure()
    ((panels, labels, *_),) = calls
    assert list(labels) == ["LQR"]  # TLC is identical in both
    record = METRIC_RECORDS["speed_error_max_mps"].label_with_unit
    (speed,) = (panel for panel in panels if panel.label == record)
    flights = [read_flown(folder).flights["lqr"] for folder in (before, after)]
    expected = metric_differences(*flights, "speed_error_max_mps")
    assert np.array_equal(speed.differences["LQR"], expected) and np.isinf(expected).sum() == 3
    assert speed.medians["LQR"][0] == 0.0
    found = read_flown(before)
    usage = [name for name in found.compared if name.endswith("_rms_deg")]
    assert [panel.label for panel in panels] == [
        METRIC_RECORDS[name].label_with_unit for name in (*found.asked, *usage)]  # fmt: skip


def entry(a_better, b_better, winner=None, **given):
    fixed = {"mixed": False, "worse_tails": (), "loses_more": False, "worst": (2.0, 5.0)}
    return SimpleNamespace(
        **{"a_better": a_better, "b_better": b_better, "winner": winner, **fixed, **given}
    )


def stub_pair(metrics, **given):
    failures, early = (
        SimpleNamespace(only_a=k, only_b=k + 1, both=k + 2, p_value=0.5) for k in (1, 4)
    )
    return SimpleNamespace(
        **{
            "a": "a",
            "b": "b",
            "pairs": 200,
            "metrics": metrics,
            "not_worse": {},
            "surfaces": {},
            "any_failure": failures,
            "ended_early": early,
            **given,
        }
    )


@pytest.mark.parametrize("judged", [True, False])
def test_each_asked_metric_is_listed_by_the_result_of_its_comparison(judged):
    results = {
        "first": entry(150, 50, "a"),
        "second": entry(50, 150, "b", worse_tails=(0.95, 0.9973), loses_more=True),
        "both": entry(120, 80, mixed=True),
        "none": entry(100, 100, worst=(None, 1.5)),
        "unasked": entry(200, 0, "a"),
    }
    names = SimpleNamespace(
        label=str.upper,
        asked=("first", "second", "both", "none"),
        metrics={k: SimpleNamespace(phrase=k, label=k.title()) for k in (*results, "rms")},
        campaign=SimpleNamespace(judged=judged),
    )
    surfaces = {"rms": SimpleNamespace(value=1.5), "none": None}
    texts = dict(_pair_texts("T", stub_pair(results, surfaces=surfaces), names, None))
    texts = {label: re.sub(r"\s", " ", text) for label, text in texts.items()}
    assert texts["Better: A"] == "T: first (better on 75 % / 25 %, worst 2.00 / 5.00)"
    assert texts["Better: B"].startswith("T: second (better on 25 % / 75 %, worst 2.00 / 5.00, ")
    assert "95 %" in texts["Better: B"] and "99.73" not in texts["Better: B"]
    assert texts["Better: B"].endswith("more early terminations)") and len(texts) == 7
    assert texts["Mixed"].startswith("T: both (better on 60 % / 40 %")
    undecided = "No difference shown" if judged else "Estimates, no winner"
    assert "none (better on 50 % / 50 %, worst \N{EM DASH} / 1.50)" in texts[undecided]
    assert texts["Control effort"].endswith(": Rms 1.5") and "None" not in texts["Control effort"]
    numbers = {label: re.findall(r"[\d.]+", texts[label]) for label in list(texts)[-2:]}
    assert numbers == {"Failed flights": ["200", "1", "2", "3", "0.50"],
                       "Early terminations": ["200", "4", "5", "6", "0.50"]}  # fmt: skip


@pytest.mark.parametrize(
    ("better", "failures", "identical"),
    [((0, 0), (0, 0), True), ((1, 0), (0, 0), False), ((0, 1), (0, 0), False),
     ((0, 0), (1, 0), False), ((0, 0), (0, 1), False)],
)  # fmt: skip
def test_pairs_are_identical_without_any_difference(better, failures, identical):
    lost = SimpleNamespace(only_a=failures[0], only_b=failures[1], both=9, p_value=1.0)
    pair = stub_pair({"x": entry(*better), "y": entry(0, 0)}, any_failure=lost)
    names = SimpleNamespace(label=str, asked=(), metrics={}, campaign=SimpleNamespace(judged=True))
    assert ("Identical" in dict(_pair_texts("T", pair, names, None))) == identical


def test_folders_of_the_same_name_are_named_by_their_paths(tmp_path):
    a, b, c = (SimpleNamespace(folder=tmp_path / name) for name in ("x/run", "y/run", "y/other"))
    assert _folder_names(a, c) == ("run", "other")
    assert _folder_names(a, b) == (str(tmp_path / "x/run"), str(tmp_path / "y/run"))


def test_metrics_that_are_not_compared_are_collapsed(failing_folder):
    items = compare(failing_folder, failing_folder, ("tlc", "lqr")).section.items
    differences, failures, fold = items[2:]
    found = read_flown(failing_folder)
    heads = [METRIC_RECORDS[name].label_with_unit for name in found.compared]
    listed = [row[0] for row in differences.plain_rows()]
    assert (
        set(listed) <= set(heads) and METRIC_RECORDS["sideslip_max_deg"].label_with_unit in listed
    )
    assert len(failures.plain_rows()) == 4 and isinstance(fold, Fold)
    others = [row[0] for row in fold.items[0].plain_rows()]
    assert not set(others) & set(heads) and len(others) > 5
