"""Tolerance limits of verdicts and the cells that show them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from report.synthetic import write_campaign
from scipy.stats import beta

from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.statistics import judge
from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.topics.formatting import percent
from abhv_mc.topics.topic import Models
from abhv_mc.topics.verdicts import VERDICTS
from abhv_mc.topics.verdicts.model import Together, _unlimited, compute_verdicts, find_tolerance

NONE = np.empty(0, int)
# numbers of flights with which 0, 1 and 2 failures pass
FIRST, SECOND, THIRD = (flights_to_pass(failures, 0.9, 0.1) for failures in range(3))


def tolerance(values, bounds, failed=(), points=1, judged=(0,), absent=NONE, early=True):
    """Return the limit for 90 % of the flights at a consumer's risk of 10 %."""
    values = np.asarray(values, float)
    flights = SimpleNamespace(
        metrics={"x": values},
        failed=np.isin(np.arange(values.size), failed),
        flight=np.arange(values.size),
        absent=np.asarray(absent),
    )
    requirement = SimpleNamespace(
        metric="x", limits=bounds, early_is_failure=early, probability=0.9, consumer_risk=0.1
    )
    return find_tolerance(flights, requirement, points, judged)


@pytest.mark.parametrize(
    ("flights", "rank"), [(FIRST, 1), (SECOND - 1, 1), (SECOND, 2), (THIRD - 1, 2), (THIRD, 3)]
)
def test_the_limit_is_the_largest_value_that_may_not_fail(flights, rank):
    values = np.random.default_rng(1).permutation(np.arange(1.0, flights + 1))
    limit = flights + 1.0 - rank
    share = pytest.approx((200 - limit) / 200)
    assert tolerance(values, Bounds(high=200)) == (limit, share, False)
    assert tolerance(-values, Bounds(low=-200)) == (-limit, share, False)


def test_two_limits_give_a_distance_and_a_share_of_half_the_width():
    values = np.linspace(-2.0, 3.0, FIRST)
    assert tolerance(values, Bounds(-4.0, 4.0)) == (-1.0, pytest.approx(0.25), False)
    assert tolerance(values, Bounds(-1.0, 5.0)) == (1.0, pytest.approx(-1.0 / 3.0), False)
    assert tolerance(values, Bounds(high=0.0))[:2] == (3.0, None)  # a share of zero


def test_too_few_flights_and_too_many_early_terminations_are_distinguished():
    values = np.ones(FIRST)
    assert tolerance(values[:-1], Bounds(high=2)) == (None, None, False)
    assert tolerance(values, Bounds(high=2), failed=[3]) == (None, None, True)
    assert tolerance(values, Bounds(high=2), failed=[3], early=False) == (1.0, 0.5, False)
    assert tolerance(values[:-1], Bounds(high=2), absent=[FIRST - 1]) == (None, None, True)
    values[5] = np.nan
    assert tolerance(values, Bounds(high=2), early=False) == (None, None, True)


def test_the_worst_of_the_judged_points_counts():
    values = np.arange(3.0 * FIRST) % 3 + 1.0  # at three points
    for judged, limit in (((0,), 1.0), ((0, 1), 2.0), ((0, 2), 3.0)):
        found = tolerance(values, Bounds(high=4), points=3, judged=judged)
        assert found == (limit, pytest.approx((4 - limit) / 4), False)
    lost = {"failed": [1], "points": 3}
    assert tolerance(values, Bounds(high=4), judged=(0, 2), **lost)[0] == 3.0
    assert tolerance(values, Bounds(high=4), judged=(0, 1), **lost) == (None, None, True)
    missing = {"absent": [3 * FIRST], "points": 3}  # one flight of the first point
    assert tolerance(values, Bounds(high=4), judged=(1,), **missing)[0] == 2.0
    assert tolerance(values, Bounds(high=4), judged=(0,), **missing) == (None, None, True)
    more = np.arange(3.0 * SECOND) % 3 + 1.0  # one failure may be lost at each point
    assert tolerance(more, Bounds(high=4), failed=[1, 5], points=3, judged=(0, 1, 2))[0] == 3.0


def cells(folder, entries, **keys):
    """Return the two cells of the tolerance limit of each requirement."""
    models = Models(
        read_flown(
            write_campaign(
                folder / "c",
                controllers=("lqr",),
                requirements=[f"{{metric: sideslip_max_deg, {e}}}" for e in entries],
                **keys,
            )
        )
    )
    section = VERDICTS.section(models[VERDICTS], models.names)
    (table,) = (table for table in section.tables() if "Tolerance limit" in table.heads)
    first = table.heads.index("Tolerance limit")
    found = [row[first : first + 2] for row in table.plain_rows()]
    limits = [entry.controllers["lqr"].tolerance_limit for entry in models[VERDICTS].requirements]
    return found, limits


def test_cells_name_the_side_of_the_limit(tmp_path):
    entries = (
        "below: 50, probability: 0.9",
        "below: 0.001, probability: 0.9",
        "above: -50, probability: 0.9",
        "above: -50, below: 50, probability: 0.9",
        "above: 40, below: 50, probability: 0.9",
        "below: 50, probability: 0.9999",
    )
    found, limits = cells(tmp_path, entries, runs=60)
    signs = [(limit[0], room.rpartition(" ")[2]) for limit, room in found[:3]]
    assert signs == [("<", "inside"), ("<", "beyond"), (">", "inside")]
    assert found[3][0].endswith(" inside") and found[4][0].endswith(" outside")
    assert [room.rpartition(" ")[2] for _, room in found[3:5]] == ["inside", "beyond"]
    assert found[5] == ["too few flights", "—"]
    for (text, _), limit in zip(found[:5], limits, strict=False):
        number = float(text.strip("<> ").split("\N{NO-BREAK SPACE}")[0].split(" ")[0])
        assert number == pytest.approx(abs(limit) if "side" in text else limit, rel=1e-3)


def test_cells_say_that_too_many_flights_terminated_early(tmp_path):
    found, _ = cells(tmp_path, ["below: 50, probability: 0.9"], runs=60, failing=59)
    assert found == [["too many early terminations", "—"]]


@pytest.mark.parametrize("bad", ["high", "low"])
def test_without_requirements_a_row_is_scaled_by_the_median_or_the_spread(tmp_path, bad):
    results = read_flown(write_campaign(tmp_path / "c", runs=60, requirements=()))
    metric = next(name for name in results.asked if results.campaign.metrics[name].bad == "high")
    records = {**results.campaign.metrics}
    records[metric] = replace(records[metric], bad=bad)
    for middle, size in ((0.0, None), (-8.0, 8.0)):
        values = middle + np.repeat([-3.0, 0.0, 3.0], 20)
        flights = {
            name: replace(own, metrics={**own.metrics, metric: values})
            for name, own in results.flights.items()
        }
        stub = SimpleNamespace(
            flights=flights,
            controllers=results.controllers,
            campaign=SimpleNamespace(metrics=records, unknowns=results.campaign.unknowns),
        )
        row = _unlimited(stub, metric)
        assert (row.limit, row.below) == (middle, bad == "high")
        assert row.size == size if size else 2.0 < row.size <= 6.0


FEW = flights_to_pass(3, 0.9, 0.1)  # number of flights with which 3 failures just pass


@pytest.fixture
def judged(flown):
    """Return results with two requirements: TLC just passes the first, and LQR fails both.

    Of TLC, flight 0 terminates early, and 1 and 2 are beyond the limit; LQR lacks one flight more.
    """
    results, number = flown(200), np.arange(FEW)
    metrics = ("sideslip_max_deg", "angle_of_attack_max_deg")
    first, second, _ = results.campaign.requirements
    traced = {"id": "R-1", "source": "S", "rationale": "why"}
    own = {"probability": 0.9, "consumer_risk": 0.1}
    items = (
        replace(first, metric=metrics[0], limits=Bounds(high=7.0), traced=traced, **own),
        replace(second, metric=metrics[1], limits=Bounds(2.0, 8.0), **own),
    )
    values = number / FEW + 5.0
    tables = {
        "tlc": ((0,), (1, 2), values, ()),
        "lqr": ((), range(FEW // 2), values + 1.5, (FEW,)),
    }
    flights = {}
    for name, (early, beyond, columns, absent) in tables.items():
        outcome = np.where(np.isin(number, early), Outcome.BANK_LIMIT, Outcome.OK)
        sideslip = np.where(np.isin(number, beyond), 9.0, number / FEW)
        flights[name] = replace(
            results.flights[name],
            flight=number,
            outcome=outcome,
            absent=np.array(absent, int),
            metrics=dict(zip(metrics, (sideslip, columns), strict=True)),
        )
    campaign = replace(results.campaign, requirements=items)
    return replace(results, campaign=campaign, flights=flights)


def test_verdicts_have_the_counts_and_bounds_of_their_flights(judged):
    found = compute_verdicts(judged)
    sideslip, attack = (entry.controllers for entry in found.requirements)
    lost = FEW // 2 + 1  # one could not be computed
    for verdict, failures, flights, early, absent in (
        (sideslip["tlc"], 3, FEW, 1, 0),
        (sideslip["lqr"], lost, FEW + 1, 0, 1),
        (attack["tlc"], 1, FEW, 1, 0),
        (attack["lqr"], 1, FEW + 1, 0, 1),
    ):
        assert (verdict.failures, verdict.flights) == (failures, flights)
        assert (verdict.ended_early, verdict.uncomputed) == (early, absent)
        expected = judge(failures - absent, flights, 0.9, 0.1, None, absent)
        assert (verdict.status, verdict.E_pass) == (expected.status, pytest.approx(expected.E_pass))
        shape = failures + 0.5, flights - failures + 0.5
        assert verdict.failure_rate == pytest.approx(beta.ppf([0.025, 0.975], *shape), rel=1e-6)
        bound = beta.ppf(0.1, flights - failures, failures + 1)
        assert verdict.one_look_bound == pytest.approx(bound, rel=1e-6)
        assert bool(verdict.advice) == (verdict.status == "NOT SHOWN")
    assert (sideslip["tlc"].status, sideslip["lqr"].status) == ("PASS", "FAIL")
    assert [entry.name for entry in found.requirements] == ["R-1", "angle_of_attack_max_deg"]
    assert found.statuses("tlc") == ["PASS", attack["tlc"].status]
    assert [(name, v) for _, name, v in found.binding] == [
        ("tlc", sideslip["tlc"]), ("tlc", attack["tlc"])]  # fmt: skip
    assert [v for _, v in found.verdicts_of("tlc")] == [sideslip["tlc"], attack["tlc"]]
    assert [v for _, v in found.verdicts_of("lqr")] == [sideslip["lqr"], attack["lqr"]]
    # TLC just passes the first: this does not hold among four verdicts.
    passes = [v for own in (sideslip, attack) for v in own.values() if v.status == "PASS"]
    dropped = ((0, "tlc"),)
    assert found.held_together == Together(0.1, 4, len(passes) - 1, dropped)


def test_cells_of_verdicts_are_those_of_the_table_in_full(judged):
    models = Models(judged)
    found = models[VERDICTS]
    section = VERDICTS.section(found, models.names)
    in_full, single = section.tables()
    rows = in_full.plain_rows()
    assert len(rows) == 4 and in_full.heads[:2] == ("Requirement", "Controller")
    thin, few = "\u202f", f"{FEW}"
    share = f"in 90{thin}% of the flights, consumer's risk 10{thin}%"
    assert rows[0][0] == f"R-1 Sideslip, max < 7\xa0deg ({share}; S · why)"
    assert rows[2][0].endswith(f"between 2 and 8\xa0deg ({share})")
    assert [row[1] for row in rows[:2]] == ["TLC (binding)", "LQR"]
    assert rows[0][2] == "PASS (not jointly)" and rows[1][2] == "FAIL"
    assert [row[3:6] for row in rows] == [
        [f"3 of {few}", "1", "0"], [f"{FEW // 2 + 1} of {FEW + 1}", "0", "1"],
        [f"1 of {few}", "1", "0"], [f"1 of {FEW + 1}", "0", "1"]]  # fmt: skip
    assert rows[0][8] == rows[1][8] == "—"
    verdicts = [v for entry in found.requirements for v in entry.controllers.values()]
    assert [row[2:] for row in single.plain_rows()] == [
        [percent(v.one_look_bound), " to ".join(map(percent, v.failure_rate))] for v in verdicts
    ]
    later = frozenset({(0, "tlc")})
    campaign = replace(judged.campaign, later_choices=later)
    models = Models(replace(judged, campaign=campaign))
    rows = VERDICTS.section(models[VERDICTS], models.names).tables()[0].plain_rows()
    assert (
        rows[0][2].startswith("PASS (set later)") and models[VERDICTS].held_together.verdicts == 3
    )


@pytest.mark.parametrize(("random", "hint"), [(True, False), (False, True)])
def test_dependent_flights_give_estimates_without_intervals(judged, monkeypatch, random, hint):
    """The sampling can be changed only where it is the reason."""
    monkeypatch.setattr(Experiment, "judged", False)
    monkeypatch.setattr(Experiment, "has_noise", random)
    models = Models(judged)
    found = models[VERDICTS]
    assert found.held_together is None and {*found.statuses("tlc")} == {"ESTIMATE"}
    verdict = found.requirements[0].controllers["tlc"]
    assert (verdict.tolerance_limit, verdict.room, verdict.beyond_lost) == (None, None, False)
    assert (verdict.one_look_bound, verdict.failure_rate) == (None, None)
    section = VERDICTS.section(found, models.names)
    (table,) = section.tables()
    assert [row[6:8] for row in table.plain_rows()] == [["—", "—"]] * 4
    assert ("sampling: random" in section.items[0].text) is hint
    monkeypatch.setattr(Experiment, "can_rerun", False)
    section = VERDICTS.section(found, models.names)
    assert "sampling: random" not in section.items[0].text


def test_the_overview_has_quantiles_of_all_flights(judged):
    """Early terminations are infinite; between two limits, the distance outside counts."""
    sideslip, attack = compute_verdicts(judged).glance
    assert (sideslip.limit, sideslip.below, sideslip.size) == (7.0, True, 7.0)
    assert (sideslip.unit, sideslip.text) == ("deg", "< 7\xa0deg")
    assert (attack.limit, attack.below, attack.size) == (0.0, True, 3.0)
    assert attack.unit == "deg outside the limits"
    number = np.arange(FEW)
    tlc = np.where(number == 0, np.inf, number / FEW)
    tlc[[1, 2]] = 9.0
    angle = number / FEW + 5.0
    outside = np.maximum(2.0 - angle, angle - 8.0)
    lqr = np.maximum(0.5 - angle, angle + 1.5 - 8.0)
    for row, name, values in (
        (sideslip, "tlc", tlc),
        (attack, "tlc", np.where(number == 0, np.inf, outside)),
        (attack, "lqr", lqr),
    ):
        cell = row.cells[name]
        quantiles = np.percentile(values, (5, 50, 95), method="nearest")
        assert [cell.low, cell.median, cell.high] == pytest.approx(quantiles)
        assert cell.worst == pytest.approx(values[np.isfinite(values)].max())
    assert sideslip.cells["tlc"].status == "PASS"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_overview_with_unknowns_has_the_widest_quantiles_of_any_point(judged, sign):
    """Even flights are at the first of two points; a limit above counts small values as bad."""
    unknowns = replace(
        judged.campaign.unknowns,
        names=("aero.lift",),
        low=np.array([0.9]),
        high=np.array([1.1]),
        points=np.array([[0.9], [1.1]]),
        parameters=judged.campaign.parameters,
    )
    limits = Bounds(high=7.0) if sign > 0 else Bounds(low=-7.0)
    items = tuple(replace(item, limits=limits) for item in judged.campaign.requirements[:1])
    campaign = replace(judged.campaign, unknowns=unknowns, requirements=items)
    number = np.arange(FEW)
    values = sign * np.where(number % 2, 3.0 + number / FEW, number / FEW)
    outcome = np.where(number == 5, Outcome.BANK_LIMIT, Outcome.OK)
    tlc = replace(judged.flights["tlc"], outcome=outcome, metrics={items[0].metric: values})
    found = compute_verdicts(replace(judged, campaign=campaign, flights={"tlc": tlc}))
    verdict = found.requirements[0].controllers["tlc"]
    assert (verdict.failures, verdict.flights, verdict.ended_early) == (1, FEW // 2, 1)
    (row,) = found.glance
    cell = row.cells["tlc"]
    values = np.where(number == 5, sign * np.inf, values)
    points = [np.percentile(values[k::2], (5, 50, 95), method="nearest") for k in (0, 1)]
    lows, medians, highs = np.transpose(points)
    found = cell.low, cell.median, cell.high
    assert found == pytest.approx((min(lows), np.mean(medians), max(highs)))
    assert cell.worst == sign * (sign * values[np.isfinite(values)]).max()
    assert (row.limit, row.below) == (7.0 * sign, sign > 0)
