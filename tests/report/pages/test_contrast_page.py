"""Unpaired comparison of two campaigns: numbers, rows, tables and figure."""

import re
from dataclasses import replace
from math import nan
from types import SimpleNamespace

import numpy as np
import pytest
from report.synthetic import REQUIREMENTS, write_campaign

from abhv_mc.api import compare
from abhv_mc.folder.controller_flights import severities
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.io.messages import InputError
from abhv_mc.report.pages import contrast_page as pages
from abhv_mc.report.pages.contrast_page import (
    Contrast,
    ContrastController,
    ContrastQuantile,
    ContrastRequirement,
    SideVerdict,
    contrast_figures,
    contrast_results,
    contrast_rows,
    contrast_section,
)
from abhv_mc.statistics.estimates import Interval, quantile
from abhv_mc.statistics.unpaired import quantile_difference, share_difference
from abhv_mc.statistics.verdicts import judge
from abhv_mc.topics.topic import Fold, Picture, Table

FAST, LOW = "speed_error_max_mps", "angle_of_attack_min_deg"
KEYS = {
    "requirements": (
        *REQUIREMENTS[1:2],
        f"{{metric: {LOW}, above: 1.5, probability: 0.5, consumer_risk: 0.2}}",
    ),
    "controllers": ("tlc", "lqr"),
}


@pytest.fixture(scope="module")
def sides(tmp_path_factory):
    """Write 60 flights of two controllers, and 40 other flights of which more are lost."""
    root = tmp_path_factory.mktemp("contrast")
    a = write_campaign(root / "first", runs=60, failing=3, **KEYS)
    b = write_campaign(root / "second", runs=40, failing=12, seed=7, **KEYS)
    return read_flown(a), read_flown(b)


def test_both_campaigns_are_judged_by_the_requirements_of_the_first(sides):
    contrast = contrast_results(*sides)
    assert [entry.controllers for entry in contrast.contrasted] == [("tlc",) * 2, ("lqr",) * 2]
    for entry in contrast.contrasted:
        flights = [side.flights[entry.controllers[0]] for side in sides]
        assert entry.flights == (60, 40)
        for item, (metric, limit, risk, probability) in zip(
            entry.requirements, ((FAST, 5.0, 0.1, 0.9973), (LOW, -1.5, 0.2, 0.5)), strict=True
        ):
            sign, counts = (1.0 if limit > 0.0 else -1.0), []
            for verdict, own in zip((item.before, item.after), flights, strict=True):
                failures = int((~(sign * own.metrics[metric] < limit) | own.failed).sum())
                status = judge(failures, own.flight.size, probability, risk).status
                assert verdict == SideVerdict(status, failures, own.flight.size)
                counts += [failures, own.flight.size]
            assert item.share_difference == share_difference(*counts)
            assert item.probability == probability
        assert set(entry.metrics) == set(contrast.words) == set(sides[0].compared)
        for metric, levels in entry.metrics.items():
            first, second = (severities(own, metric) for own in flights)
            sense = sides[0].campaign.metrics[metric].bad
            assert list(levels) == ["q50", "q95", "q99.73"]
            for level, pair in zip((0.5, 0.95, 0.9973), levels.values(), strict=True):
                assert pair.before == quantile(first, level).in_sense(sense)
                assert pair.after == quantile(second, level).in_sense(sense)
                difference = quantile_difference(first, second, level)
                assert pair.difference == (difference and difference.in_sense(sense))
    median = contrast.contrasted[0].metrics[LOW]["q50"]
    assert median.before.value == pytest.approx(
        np.median(sides[0].flights["tlc"].metrics[LOW]), rel=0.02
    )
    assert median.difference.value == pytest.approx(median.after.value - median.before.value)
    found = {change.partition(":")[0]: change for change in contrast.changes}
    assert re.findall(r"\d+", found["seed"]) == ["2014", "7"]
    assert re.findall(r"\d+", found["runs"]) == ["60", "40"]


@pytest.mark.parametrize("changed", [0, 1])
def test_flights_that_are_not_independent_give_estimates(sides, changed):
    pair, campaign = list(sides), sides[changed].campaign
    campaign = replace(campaign, repeatability=SimpleNamespace(is_evidence=False))
    pair[changed] = replace(sides[changed], campaign=campaign)
    items = [item for entry in contrast_results(*pair).contrasted for item in entry.requirements]
    assert {side.status for item in items for side in (item.before, item.after)} == {"ESTIMATE"}


def test_flight_code_is_named_by_its_commit_or_its_hash(sides):
    a, b = (
        replace(side, manifest=replace(side.manifest, source_hash=hash_, commit=commit))
        for side, hash_, commit in zip(sides, ("1" * 20, "2" * 20), (None, "c" * 20), strict=True)
    )
    code = [change for change in pages.find_changes(a, b) if change.startswith("flight code")]
    assert code == [f"flight code: {'1' * 12} -> {'c' * 12}"]
    same = replace(b, manifest=replace(b.manifest, source_hash="1" * 20))
    assert not any("flight code" in change for change in pages.find_changes(a, same))
    assert "runs: 40 -> 60" in pages.find_changes(b, a)


def test_campaigns_with_unknowns_are_refused(sides):
    a, b = sides
    unknowns = SimpleNamespace(names=("x",))
    a = replace(a, campaign=replace(a.campaign, unknowns=unknowns))
    for pair in ((a, b), (b, a)):
        with pytest.raises(InputError, match="unknowns"):
            contrast_results(*pair)


def requirement(words, statuses, failures, difference, flights=(100, 200)):
    before, after = (SideVerdict(*side) for side in zip(statuses, failures, flights, strict=True))
    return ContrastRequirement(words, 0.9, before, after, Interval(*difference))


SURE, UNSURE = (0.15, 0.1, 0.2), (0.15, -0.1, 0.4)


@pytest.fixture
def contrast():
    """Return a contrast of two controllers in two requirements and two metrics."""
    shifts = [Interval(1.0, 0.5, 1.5), Interval(-1.0, -1.5, -0.5), Interval(1.0, -0.5, 2.0), None]
    levels = {
        f"q{5 + 30 * k}": ContrastQuantile(Interval(k, k, k), Interval(9.0 + k, 9, 9), shift)
        for k, shift in enumerate(shifts)
    }
    first = [
        requirement("E < 1 m", ("PASS", "FAIL"), (5, 40), UNSURE),
        requirement("F < 2 m", ("PASS", "PASS"), (1, 2), UNSURE),
    ]
    second = [
        requirement("E < 1 m", ("FAIL", "FAIL"), (10, 50), SURE),
        requirement("F < 2 m", ("PASS", "NOT SHOWN"), (0, 4), (0.02, 0.0, 0.1)),
    ]
    entries = [
        ContrastController((name, other), (100, 200), tuple(items), {FAST: levels, LOW: levels})
        for name, other, items in (("tlc", "tlc", first), ("lqr", "lqr_retuned", second))
    ]
    words = {FAST: {"label_with_unit": "Fast (m/s)"}, LOW: {"label_with_unit": "Low (deg)"}}
    return Contrast(("name: a -> b", "seed: 1 -> 2"), words, tuple(entries))


def test_the_rows_have_shares_and_quantiles_with_their_differences(contrast):
    rows = list(contrast_rows(contrast))
    assert len(rows) == 2 * (2 + 2 * 4)
    shares = ("share that fails", 0.05, 0.2, *UNSURE)
    assert rows[0] == ("tlc", "tlc", "E < 1 m", *shares)
    assert rows[2:5] == [
        ("tlc", "tlc", FAST, "5 % quantile", 0, 9.0, 1.0, 0.5, 1.5),
        ("tlc", "tlc", FAST, "35 % quantile", 1, 10.0, -1.0, -1.5, -0.5),
        ("tlc", "tlc", FAST, "65 % quantile", 2, 11.0, 1.0, -0.5, 2.0),
    ]
    np.testing.assert_equal(rows[5][4:], (3, 12.0, nan, nan, nan))
    assert rows[10][:3] == ("lqr", "lqr_retuned", "E < 1 m") and rows[10][4:6] == (0.1, 0.25)


def section(sides, contrast, asked=(FAST,)):
    a = SimpleNamespace(folder=sides[0].folder, campaign=SimpleNamespace(kind="controller"))
    a.asked = asked
    found = contrast_section(a, sides[1], contrast, ("A", "B"))
    lines = {
        record.label: [entry.text for entry in record.entries] for record in found.items[0].records
    }
    return lines, found.items[1:]


def test_changed_verdicts_and_significant_changes_are_summarized(sides, contrast):
    lines, _ = section(sides, contrast)
    assert lines["Changed inputs"] == ["seed: 1 -> 2"]
    text = {label: [re.sub(r"\s", " ", x) for x in texts] for label, texts in lines.items()}
    assert text["PASS -> FAIL"] == [
        "TLC: E < 1 m, failed 5 % -> 20 % (not significant)"]  # fmt: skip
    assert text["FAIL -> FAIL"] == [
        "LQR -> LQR retuned: E < 1 m, failed 10 % -> 25 % (significant)"]  # fmt: skip
    assert text["PASS -> NOT SHOWN"][0].endswith("0 % -> 2 % (not significant)")
    assert "Verdicts unchanged" not in lines and "Requirements" not in lines
    first, _ = contrast.contrasted
    same = replace(first, requirements=first.requirements[1:])
    lines, _ = section(sides, replace(contrast, contrasted=(same,)))
    assert lines["Verdicts unchanged"] == ["TLC: 1 PASS of 1"]
    lines, _ = section(sides, replace(contrast, contrasted=(replace(first, requirements=()),)))
    assert lines["Requirements"] == ["none"] and "Verdicts unchanged" not in lines


def plain(table):
    return [[re.sub(r"\s", " ", cell).replace("\N{MINUS SIGN}", "-") for cell in row]
            for row in table.plain_rows()]  # fmt: skip


def test_the_tables_list_verdicts_and_shown_differences(sides, contrast):
    _, (picture, verdicts, differing, fold) = section(sides, contrast)
    assert isinstance(picture, Picture) and isinstance(fold, Fold)
    assert verdicts.heads == ("Requirement", "Controller", "A", "B", "Difference")
    head, other = "E < 1 m in 90 %", "F < 2 m in 90 %"
    rows = [row[:4] for row in plain(verdicts)]
    assert rows == [
        [head, "TLC", "PASS, 5", "FAIL, 40"],
        [head, "LQR -> LQR retuned", "FAIL, 10", "FAIL, 50"],
        [other, "TLC", "PASS, 1", "PASS, 2"],
        [other, "LQR -> LQR retuned", "PASS, 0", "NOT SHOWN, 4"],
    ]
    assert [re.findall(r"-?[\d.]+", row[4]) for row in plain(verdicts)][:2] == [
        ["15", "-10", "40"], ["15", "10", "20"]]  # fmt: skip
    assert ", in 100 and 200 flights" in verdicts.caption
    rows = [row[:5] for row in plain(differing)]
    labels = ("TLC", "LQR -> LQR retuned")
    assert rows == [
        ["Fast (m/s)", label, f"{level} %", *ends]
        for label in labels
        for level, ends in ((5, ["0", "9.00"]), (35, ["1.00", "10.0"]))
    ]
    (every,) = fold.items
    assert len(plain(every)) == 2 * 2 * 4 and [row[5] for row in plain(every)][3] == "\N{EM DASH}"
    assert every.heads == ("Metric", "Controller", "Quantile", "A", "B", "Difference")
    assert every.title != differing.title


def test_counts_of_unequal_numbers_of_flights_have_their_total(sides, contrast):
    first, second = contrast.contrasted
    item = requirement("E < 1 m", ("PASS", "FAIL"), (5, 40), UNSURE, flights=(100, 199))
    second = replace(second, requirements=(item, item))
    _, items = section(sides, replace(contrast, contrasted=(first, second)), asked=())
    assert [type(item) for item in items] == [Picture, Table, Fold]
    assert plain(items[1])[1][2:4] == ["PASS, 5 of 100", "FAIL, 40 of 199"]
    assert " in 100" not in items[1].caption


def test_the_figure_has_a_dashed_curve_for_the_first_campaign(sides, monkeypatch):
    calls = []
    monkeypatch.setattr(pages, "plot_distributions", lambda *given: calls.append(given))
    monkeypatch.setattr(pages, "make_spread", lambda campaign, metric, flights: (metric, flights))
    contrast = contrast_results(*sides)
    ((text, _),) = contrast_figures(*sides, contrast, ("A", "B"))
    ((spreads, labels, colors, dashed),) = calls
    names = ["TLC, A", "TLC, B", "LQR, A", "LQR, B"]
    assert (text.name, list(labels), dashed) == ("distributions", names, ["TLC, A", "LQR, A"])
    assert colors["TLC, A"] == colors["TLC, B"] != colors["LQR, A"] == colors["LQR, B"]
    assert [metric for metric, _ in spreads] == [FAST, LOW]
    for name, flights in spreads[0][1].items():
        side = sides["B" in name].flights[name[:3].lower()]
        assert np.array_equal(flights.metrics[FAST], side.metrics[FAST])
    assert not list(contrast_figures(*sides, replace(contrast, words={}), ("A", "B")))
    many = {f"m{k}": {} for k in range(8)}
    a = SimpleNamespace(asked=tuple(many), folder=sides[0].folder, flights=sides[0].flights)
    a.campaign = sides[0].campaign
    list(contrast_figures(a, sides[1], replace(contrast, words=many), ("A", "B")))
    assert [metric for metric, _ in calls[-1][0]] == [f"m{k}" for k in range(6)]


def test_other_samples_are_contrasted_unless_pairs_are_required(sides):
    folders = [side.folder for side in sides]
    comparison = compare(*folders)
    assert isinstance(comparison.found, Contrast)
    assert len(comparison.table) == len(list(contrast_rows(comparison.found)))
    assert list(comparison.table)[4:6] == ["first", "second"]
    with pytest.raises(InputError, match=r"atmosphere\.density"):
        compare(*folders, fail_if_worse={FAST: 0.05})
