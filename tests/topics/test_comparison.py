"""Comparison of all pairs of controllers in the leading metrics."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.campaign.file.unknowns import Unknowns
from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.comparison import COMPARISON, _pair_row, pair_tables
from abhv_mc.topics.comparison.model import (
    ComparedMetric,
    ControllerPair,
    ListedFailures,
    Standing,
    compare_any_failures,
    compare_pair,
    compute_comparison,
    make_standings,
    metric_differences,
    total_usage,
    usage_metrics,
)
from abhv_mc.topics.topic import Models

METRIC = "sideslip_max_deg"
EQUAL = ("altitude_error_max_m", "speed_error_max_mps")


@pytest.fixture
def results(flown):
    return flown(200)


@pytest.fixture
def unknown(results):
    """Return results whose second half of flights is at a second value of an unknown."""
    unknowns = Unknowns(("aero.lift",), np.array([0.9]), np.array([1.1]), np.array([[0.9], [1.1]]))
    return replace(results, campaign=replace(results.campaign, unknowns=unknowns))


def compared(results, errors):
    """Return the comparison for given errors in one metric and equal ones in the others."""
    equal = dict.fromkeys(EQUAL, np.ones(200))
    flights = {
        name: replace(results.flights[name], metrics={METRIC: errors[name], **equal})
        for name in errors
    }
    return compute_comparison(replace(results, flights=flights)).pairs


@pytest.mark.parametrize(("count", "winner"), [(127, None), (128, "tlc")])
def test_winners_allow_for_all_metrics_and_rivals_of_the_first_screen(results, count, winner):
    """Three pairs and three metrics need 128 of 200 flights; three metrics alone need 126."""
    errors = {name: np.full(200, 1.2) for name in results.controllers}
    errors["tlc"] = np.where(np.arange(200) < count, 1.0, 1.5)
    pairs = compared(results, errors).values()
    assert {pair.metrics[METRIC].closer for pair in pairs if "tlc" in (pair.a, pair.b)} == {winner}


def test_flights_that_fail_with_only_one_controller_are_listed(results):
    outcome = np.zeros((2, 200), int)
    outcome[0, [2, 5, 9]] = outcome[1, [5, 11]] = 3
    tlc, lqr = (
        replace(results.flights[name], outcome=row)
        for name, row in zip(("tlc", "lqr"), outcome, strict=True)
    )
    found = compare_any_failures(tlc, lqr, ())
    assert (found.only_a, found.only_b, found.both) == (2, 1, 1)
    assert (found.flights_only_a, found.flights_only_b) == ((2, 9), (11,))


@pytest.mark.parametrize(("lost", "losing"), [(6, None), (7, "lqr")])
def test_three_pairs_share_the_risk_of_early_terminations(results, lost, losing):
    """6 flights have a p-value of 3.1 %, and 7 have 1.6 %; each pair has a third of 5 %."""
    outcome = np.where(np.arange(200) < lost, 3, 0)
    flights = {
        name: replace(results.flights[name], outcome=outcome * (name == "lqr"))
        for name in results.controllers
    }
    pairs = compute_comparison(replace(results, flights=flights)).pairs
    assert [pair.losing for pair in pairs.values()] == [losing, losing, None]


@pytest.mark.parametrize(
    ("worse_at_second", "winner"),
    [
        (0.5, "tlc"),
        (1.5, None),  # closer at the first value, no better at the second
        (2.5, None),
    ],
)
def test_with_unknowns_a_winner_is_one_at_every_value(unknown, worse_at_second, winner):
    """TLC has the smaller error in three quarters of all flights in the first two."""
    at_second = np.arange(200) % 2 == 1
    of_first = np.where(at_second, worse_at_second, 0.5)
    if worse_at_second == 1.5:
        of_first[at_second & ((np.arange(200) // 2) % 2 == 1)] = 0.5
    pair = compared(unknown, {"tlc": of_first, "lqr": np.ones(200)})["lqr - tlc"]
    entry = pair.metrics[METRIC]
    assert (entry.winner, entry.mixed) == (winner, winner is None)


@pytest.mark.parametrize(("step", "losing"), [(2, None), (1, "lqr")])
def test_with_unknowns_more_lost_flights_are_more_at_every_value(unknown, step, losing):
    """Lost flights at one value of an unknown are no evidence for the other value."""
    outcome = np.zeros(200, int)
    outcome[step - 1 : 160 : step] = 3
    flights = {
        name: replace(unknown.flights[name], outcome=lost)
        for name, lost in (("tlc", np.zeros(200, int)), ("lqr", outcome))
    }
    assert compute_comparison(replace(unknown, flights=flights)).pairs["lqr - tlc"].losing == losing


def test_of_a_metric_whose_small_values_are_bad_the_worst_is_the_smallest(results):
    metric, names = "angle_of_attack_min_deg", ("tlc", "lqr")
    flights = [results.flights[name] for name in names]
    entry = compare_pair(*flights, names, [metric], [], requirements=()).metrics[metric]
    a, b = (table.metrics[metric] for table in flights)
    assert entry.worst == (a.min(), b.min()) and entry.a_better == np.sum(a > b)


def test_winners_are_named_in_compared_metrics_of_independent_flights(results):
    flights = [results.flights[name] for name in ("tlc", "lqr")]

    def entry(compared, **keys):
        pair = compare_pair(*flights, ("tlc", "lqr"), [METRIC], compared, requirements=(), **keys)
        return pair.metrics[METRIC]

    alone = entry([METRIC])
    assert (alone.compared, alone.winner, alone.closer, alone.mixed) == (True, "tlc", "tlc", False)
    for other in (entry([]), entry([METRIC], independent=False)):
        assert (other.compared, other.winner, other.closer) == (False, None, None)
    assert alone.quantile_differences["q95"].value < 0.0 < alone.worst[1] - alone.worst[0]
    none = replace(flights[1], flight=flights[1].flight + 200)
    assert compare_pair(flights[0], none, ("a", "b"), [], [], requirements=()) is None
    squares = [flights[0].metrics[name] ** 2 for name in usage_metrics(flights[0])]
    assert len(squares) == 3 and total_usage(flights[0]) == pytest.approx(sum(squares) ** 0.5)
    lost = replace(flights[0], outcome=np.where(np.arange(200) % 3 == 1, 3, 0))
    assert compare_any_failures(lost, flights[0], ()).flights_only_a == tuple(range(1, 30, 3))


@pytest.mark.parametrize(("value", "wins"), [(1.2, False), (1.0, True)])
def test_only_differences_with_a_winner_are_bold(results, value, wins):
    errors = {name: np.full(200, 1.2) for name in results.controllers}
    errors["tlc"] = np.full(200, value)
    pair = next(p for p in compared(results, errors).values() if "tlc" in (p.a, p.b))
    names = SimpleNamespace(label=str.upper)
    *heads, won, equal = _pair_row(pair, names, (METRIC, EQUAL[0]))
    assert [head.text for head in heads] == [pair.a.upper(), pair.b.upper()]
    assert (won.best, equal.best) == (wins, False)


def test_a_pair_has_a_table_of_differences_and_one_of_failures():
    def metric(better, gain, **entries):
        standard = {"compared": True, "winner": None, "closer": None, "mixed": False}
        return ComparedMetric(
            a_better=better,
            b_better=100 - better,
            ties=0,
            median_difference=Interval(-2.04, -2.5, -1.6),
            pairing_gain=gain,
            worse_tails=(),
            uncompared_tails=(),
            loses_more=False,
            worst=(1.0, 2.0),
            quantile_differences={
                "q50": Interval(7.0, 6.0, 8.0),
                "q95": Interval(3.1, 2.5, 3.7),
                "q99.73": Interval(np.inf, 4.0, np.inf),
            },
            **standard | entries,
        )

    def failures(both, only_a, only_b, p_value, *flights):
        counts = {"both": both, "only_a": only_a, "only_b": only_b, "p_value": p_value}
        first, second = flights
        return ListedFailures(
            **counts,
            neither=1100 - both - only_a - only_b,
            flights_only_a=first,
            flights_only_b=second,
        )

    metrics = {
        "a": metric(70, 1.05, winner="tlc"),
        "b": metric(30, 1.04, mixed=True),
        "c": metric(50, None),
        "d": metric(1, 12.34, compared=False, mixed=True),
    }
    pair = ControllerPair(
        a="tlc",
        b="lqr",
        pairs=1100,
        metrics={},
        requirements=(failures(3, 2, 11, 0.0224, (7, 9), tuple(range(10))),),
        ended_early=failures(0, 0, 1, 1.0, (), (4,)),
        losing=None,
        surfaces={},
    )
    names = SimpleNamespace(
        label=str.upper,
        metrics={name: SimpleNamespace(label_with_unit=f"{name} (m)") for name in metrics},
        campaign=SimpleNamespace(kind="controller"),
    )
    differences, lost = pair_tables(pair, names, metrics, ["x < 3"])
    assert (
        differences.heads[4] == "TLC better in"
        and "TLC minus quantiles of LQR" in differences.caption
    )
    ends = ["−2.0 (−2.5 to −1.6)", "3.1 (2.5 to 3.7)", "not reached"]
    assert differences.plain_rows() == [
        ["a (m)", *ends, "70 of 1100", "1.1 times", "TLC"],
        ["b (m)", *ends, "30 of 1100", "none", "mixed"],
        ["c (m)", *ends, "50 of 1100", "none", "neither"],
        ["d (m)", *ends, "1 of 1100", "12 times", ""],
    ]
    assert lost.heads[1:] == (
        "Both failed", "Only TLC", "Only LQR", "Neither", "p-value",
        "Flights, only TLC", "Flights, only LQR")  # fmt: skip
    assert [row[1:] for row in lost.plain_rows()] == [
        ["3", "2", "11", "1084", "0.022", "7, 9", "0, 1, 2, 3, 4, 5, 6, 7, 8, 9, …"],
        ["0", "0", "1", "1099", "1.0", "—", "4"],
    ]


def test_standings_need_a_win_over_every_other_controller():
    def pair(a, b, winner):
        return SimpleNamespace(a=a, b=b, metrics={"m": SimpleNamespace(winner=winner)})

    names = ("x", "y", "z")
    for winners, best, not_beaten in (
        (("x", "x", None), "x", ("x",)),
        (("x", None, None), None, ("x", "z")),
        (("y", "z", "z"), "z", ("z",)),
        ((None, None, None), None, names),
        (("x", "z", "y"), None, ()),
    ):
        pairs = [pair(*own) for own in zip("xxy", "yzz", winners, strict=True)]
        assert make_standings(pairs, names) == {"m": Standing(best, not_beaten)}
    assert make_standings([], names) == {}


def test_bold_cells_are_of_winners_and_of_significant_losses(results):
    """TLC is closer on all flights; LQR loses 40 flights and misses a limit on 3 others."""
    number, names = np.arange(200), results.controllers
    equal = dict.fromkeys(EQUAL, np.ones(200))
    flights = {}
    for name in names:
        sideslip = np.full(200, 0.1 if name == "tlc" else 0.2) + 1e-3 * number / 200
        sideslip[(number > 150) & (number < 154)] += 0.9 * (name == "lqr")
        outcome = np.where((number < 40) & (name == "lqr"), 3, 0)
        metrics = {METRIC: sideslip, **equal}
        flights[name] = replace(results.flights[name], metrics=metrics, outcome=outcome)
    models = Models(replace(results, flights=flights))
    found = models[COMPARISON]
    assert found.standings[METRIC] == Standing("tlc", ("tlc",))
    by_metric, differences, failures = models.section(COMPARISON).tables()
    cells = {row[0].text: row[1:] for group in by_metric.groups for row in group}
    assert [cell.best for cell in cells["Sideslip, max (deg)"]] == [True, False, False]
    assert [cell.best for cell in cells["Altitude error, max (m)"]] == [True, False, True]
    assert not any(cell.best for cell in cells["Early terminations"])
    assert by_metric.heads == ("Metric", *models.names.controllers.values())
    rows = {row[0]: row[1:] for row in by_metric.plain_rows()}
    of = " (of 200)"
    assert rows["Early terminations"] == [f"0{of}", f"40{of}", f"0{of}"]
    (third,) = (text for text in rows if text.startswith("Failures, Sideslip"))
    assert rows[third] == [f"0{of}", f"43{of}", f"0{of}"]
    tlc = rows["Sideslip, max (deg)"][0]
    assert tlc.startswith("0.10") and tlc.endswith("/ 0.101)") and "*" in tlc
    assert rows["Sideslip, max (deg)"][1].endswith("not reached / 1.10)")
    pairs = [("LQR", "LQR retuned"), ("LQR", "TLC"), ("LQR retuned", "TLC")]
    starts = [[text.partition(" (")[0] for text in row[:2]] for row in differences.plain_rows()]
    assert starts == [[*pair] for pair in pairs]
    where = {head.partition(",")[0]: k for k, head in enumerate(differences.heads)}
    for metric, bold in (("Sideslip", [True] * 3), ("Altitude error", [True, True, False])):
        cells = [row[where[metric]] for row in differences.groups[0]]
        assert [cell.best for cell in cells] == bold
        assert [cell.note.rpartition(", ")[2] for cell in cells] == ["0\u202f%"] * 3
    cells = [row[-1] for row in failures.groups[0]]
    assert [cell.text for cell in cells] == ["40 / 0", "40 / 0", "0 / 0"]
    assert [cell.best for cell in cells] == [True, True, False]
    assert [cell.note for cell in cells] == ["p < 0.0001", "p < 0.0001", ""]
    cells = [row[where["Sideslip"]] for row in failures.groups[0]]
    assert [cell.text for cell in cells] == ["43 / 0", "43 / 0", "0 / 0"]


def test_control_effort_is_compared_by_its_median_ratio(results):
    tlc, lqr = (results.flights[name] for name in ("tlc", "lqr"))
    factor = 1.0 + np.arange(200) / 100.0
    name = usage_metrics(tlc)[0]
    other = {**lqr.metrics, name: tlc.metrics[name] / factor}
    lqr = replace(lqr, flight=lqr.flight[::-1], metrics={k: v[::-1] for k, v in other.items()})
    pair = compare_pair(tlc, lqr, ("tlc", "lqr"), [], [], requirements=())
    ratio = pair.surfaces[name]
    assert ratio.value == pytest.approx(np.median(factor), rel=1e-3)
    assert ratio.low < ratio.value < ratio.high and pair.pairs == 200
    del other[name]
    without = replace(results.flights["lqr"], metrics=other)
    assert name not in compare_pair(tlc, without, ("a", "b"), [], [], requirements=()).surfaces


@pytest.mark.parametrize(("bad", "sign"), [("high", 1.0), ("low", -1.0)])
def test_differences_are_infinite_where_only_one_flight_is_lost(results, bad, sign):
    number = np.arange(200)

    def flights(name, values, lost):
        own = results.flights[name]
        records = {**own.records, METRIC: replace(own.records[METRIC], bad=bad)}
        outcome = np.where(np.isin(number, lost), 3, 0)
        return replace(own, metrics={METRIC: values}, outcome=outcome, records=records)

    a = flights("tlc", 2.0 * number, [0, 1])
    b = flights("lqr", 1.0 * number, [1, 2])
    expected = number.astype(float)
    expected[:3] = sign * np.inf, 0.0, -sign * np.inf
    assert metric_differences(a, b, METRIC).tolist() == expected.tolist()


def test_required_metrics_come_before_control_effort_and_angles(results):
    """The figure of control effort is there where control effort is compared."""
    models = Models(results)
    found, names = models[COMPARISON], models.names
    section = COMPARISON.section(found, names)
    groups = [[row[0].text for row in group] for group in section.tables()[0].groups]
    records = {record.label_with_unit: record for record in names.metrics.values()}
    assert groups[0] == [names.metrics[metric].label_with_unit for metric in names.asked]
    assert {records[text].group for text in groups[1]} == {"usage"}
    assert {(records[text].group, records[text].unit) for text in groups[2]} == {
        ("tracking", "deg")
    }
    assert len(groups) == 4 and len(groups[3]) == 4
    leading = {metric: found.standings[metric] for metric in names.asked}
    without = COMPARISON.section(replace(found, standings=leading), names)
    assert len(without.items) == len(section.items) - 1
    assert len(without.tables()[0].groups) == 3
