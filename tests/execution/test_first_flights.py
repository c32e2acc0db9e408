"""First flights of a custom simulator, each flown in two new processes."""

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fake_flight import ENGINE, make_plan, write_campaign
from own_simulators import dive_campaign

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.execution import first_flights as module
from abhv_mc.execution.executor import FlightRunner, make_ready
from abhv_mc.execution.first_flights import (
    _find_not_finite,
    _judge_repeats,
    _Repeats,
    find_ineffective,
    fly_first,
    fly_probes,
)
from abhv_mc.external_simulators.simulator import ExternalSimulator
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.flights.outcomes import OUTCOMES, Outcome
from abhv_mc.flights.repeatability import Repeatability
from abhv_mc.io.messages import InputError, InputErrors

ROWS = np.array([[1.0], [2.0]])
LOST = float(Outcome.FAILED_TO_RUN)


def repeats(first, again, outcome=0.0, reasons=None):
    """Return both flights of two rows, or only the first row's second flight."""
    values = np.array([*first, *again[::-1]])
    rows = np.concatenate([ROWS, ROWS[::-1] if len(again) == 2 else ROWS[: len(again)]])
    block = FlightBlock(np.zeros(2, int), np.zeros(2), np.zeros((2, 1)), reasons=reasons or {})
    outcomes = np.full(len(values), outcome)
    return _Repeats(rows, np.column_stack([outcomes, values]), (block,), 2)


@pytest.mark.parametrize(
    ("first", "second", "found", "if_declared"),
    [
        (((3, 4), (3, 4)), ((3, 4), (3, 4)), "EXACT", "DECLARED"),
        (((3, 4), (3, 4)), ((3, 4), (3,)), "EXACT", "DECLARED"),
        (((3, 4), ()), ((3, 4), (3,)), "EXACT", "DECLARED"),
        (((3, 4), (3, 4)), ((3, 4 + 1e-11), (3, 4 + 1e-11)), "ROUNDING", "DECLARED"),
        (((3, 4), (3, 4 + 1e-11)), ((3, 4), (3, 4)), "ROUNDING", "DECLARED"),
        (((3, 4), (3, 4)), ((3, 5), (3, 5)), "NOISE", "DECLARED"),
        (((3, 4), (3, 4)), ((3, 4), (3, 5)), "NOISE", "DECLARED"),
        (((3, 4), (3, 5)), ((3, 4), (3, 5)), "NOISE", "SHARED"),
        (((3, 4), (3, 5)), ((3, 6), (3, 7)), "NOISE", "DECLARED"),
    ],
)
def test_noise_is_shared_if_new_processes_draw_the_same(first, second, found, if_declared):
    """The two processes of a pair are next to each other; the other pair repeats all numbers."""
    same = repeats((1, 2), (1, 2))
    for declared, state in ((False, found), (True, if_declared)):
        campaign = SimpleNamespace(
            simulator=SimpleNamespace(states_noise=declared),
            measured=[SimpleNamespace(name="miss")],
            inputs=("a",),
            outcomes=OUTCOMES,
        )
        pairs = [same, same, repeats(*first), repeats(*second)]
        judged, warnings = _judge_repeats(campaign, {"s": [same] * 4, "t": pairs})
        assert judged == Repeatability[state]
        assert len(warnings) == (state in ("NOISE", "SHARED"))
        assert all("'t' returns miss" in warning for warning in warnings)


@pytest.fixture
def campaign(tmp_path):
    read = read_campaign(dive_campaign(tmp_path, systems={"v1": {}, "v2": {}}, runs=20))
    return make_ready(read, read.simulator.make_plans(read.controllers))


@pytest.mark.parametrize("lost", ["none", "one process", "one system"])
def test_a_system_without_any_computed_flight_is_rejected(campaign, monkeypatch, lost):
    fine, gone = repeats((3, 4), (3, 4)), repeats((0, 0), (0, 0), LOST, {1: "burst"})
    flown = {
        "v1": [fine, fine],
        "v2": {"none": [fine, fine], "one process": [gone, fine], "one system": [gone, gone]}[lost],
    }
    monkeypatch.setattr(module, "_fly_twice", lambda *_: (flown, ["native"]))
    monkeypatch.setattr(module, "_judge_repeats", lambda *_: (Repeatability.NOISE, ["noisy"]))
    monkeypatch.setattr(ExternalSimulator, "time_of_flight", lambda *_: 9.0)
    if lost == "one system":
        with pytest.raises(InputError, match=r"'v2'.*\(burst\)"):
            fly_first(campaign, 1, {})
        return
    assert fly_first(campaign, 1, {}) == (("native", "noisy"), Repeatability.NOISE, {})


@pytest.mark.parametrize(
    ("workers", "seconds", "first", "again"),
    [
        (1, None, [8, 8], [8, 8]),
        (4, 1.0, [4] * 4, [4] * 4),
        (4, 1.1, [4] * 4, [1, 1, 0, 0]),
        (99, 0.0, [2] * 8, [2] * 8),
    ],
)
def test_rows_are_flown_by_pairs_of_processes(
    campaign, monkeypatch, workers, seconds, first, again
):
    """Lost flights are flown again if the other process computed them: row 3 here, not row 6."""
    rows, lost = campaign.make_samples().draw(0, 8), Counter()
    monkeypatch.setattr(ExternalSimulator, "time_of_flight", lambda *_: seconds)
    columns = campaign.rows(rows)

    def fly(plan, parameters, recorded=None):
        is_3, is_6 = ((parameters == columns[row]).all(axis=1) for row in (3, 6))
        first_time = plan.controller == "v1" and is_3.any() and not lost[3]
        lost[3] += first_time
        outcome = np.where(is_6 | (is_3 & first_time), int(LOST), 0)
        return FlightBlock(outcome, np.ones(len(outcome)), parameters[:, :2])

    flown, _ = module._fly_twice(campaign, FlightRunner(fly, workers), rows)
    pairs = len(first) // 2
    for processes in flown.values():
        assert [process.distinct for process in processes] == first
        assert [len(process.rows) - process.distinct for process in processes] == again
        for k, process in enumerate(processes):
            own = rows[k // 2 :: pairs]
            more = own[::-1] if again[k] == len(own) else own[: again[k]]
            np.testing.assert_array_equal(process.rows, np.concatenate([own, more]))
            assert (process.lost == (process.rows == rows[6]).all(axis=1)).all()
            np.testing.assert_array_equal(process.values[:, 1:], campaign.rows(process.rows)[:, :2])


def test_metrics_of_nominal_flights_must_be_finite():
    """Only the first trial counts, and a flight that ended early may lack a metric."""
    names = ("fine", "none", "endless", "own")
    metrics = [SimpleNamespace(name=name, of="x") for name in names]
    metrics[3].of = "heat_flux_w_m2"
    document = SimpleNamespace(key_error=lambda *entries: entries)
    campaign = SimpleNamespace(measured=metrics, document=document)
    nan, inf = np.nan, np.inf

    def block(outcome, *values):
        rows = np.array([values, [nan] * 4])
        return FlightBlock(np.array([outcome, 0]), np.ones(2), rows)

    flown = {
        "a": block(Outcome.BANK_LIMIT, nan, nan, nan, nan),
        "b": block(0, 1.0, nan, -inf, 1.0),
        "c": block(0, 1.0, inf, 1.0, nan),
    }
    errors = list(_find_not_finite(campaign, flown))
    assert [keys for keys, *_ in errors] == [("metrics", name) for name in names[1:]]
    for (_, problem, expected), number, system in zip(
        errors, ("not a number", "-inf", "not a number"), "bbc", strict=True
    ):
        assert f"is {number} in" in problem and problem.endswith(f"'{system}'")
        assert ("nose_radius" in expected) == (system == "c")


@pytest.mark.parametrize("changed", ["metrics", "outcome", "end_time"])
def test_a_dispersion_has_an_effect_if_one_flight_differs(changed):
    """Trials of `b`, rows 4 to 6, differ in the third; those of `a` equal each other."""
    campaign = SimpleNamespace(dimensions=("a", "b"))
    trials = np.arange(14.0).reshape(7, 2)
    values = {"outcome": np.zeros(7, int), "end_time": np.ones(7), "metrics": np.ones((7, 1))}
    same = FlightBlock(**{name: value.copy() for name, value in values.items()})
    for rows in (slice(0, 1), slice(6, 7)):
        values[changed][rows] = 2
    values["metrics"][1:4] = np.nan
    found = list(find_ineffective(campaign, trials, [same, FlightBlock(**values)]))
    assert found == [("a", 4.0, 6.0)]
    assert [name for name, *_ in find_ineffective(campaign, trials, [same])] == ["a", "b"]


@pytest.mark.parametrize(
    ("entries", "line"),
    [
        ({}, "  dispersions:"),
        ({"unknowns": "{mass.total: {low: 0.95, high: 1.05}}"}, "unknowns:"),
    ],
)
def test_a_parameter_without_effect_is_marked_in_its_entry(tmp_path, entries, line):
    key = line.strip(" :")
    entries = entries or {
        "dispersions": "{aero.lift: {distribution: normal, sigma: 5 %}, mass.total: "
        "{distribution: uniform, half_width: 5 %}}"
    }
    file = write_campaign(tmp_path, **entries)
    campaign = read_campaign(file)
    plans = {name: make_plan(name) for name in campaign.controllers}
    ready = make_ready(replace(campaign, engine=ENGINE), plans)
    with pytest.raises(InputErrors, match=r"'mass\.total'") as caught:
        fly_probes(ready, {})
    (error,) = caught.value.errors
    assert file.read_text("utf-8").splitlines()[error.line - 1].startswith(f"{key}:")
