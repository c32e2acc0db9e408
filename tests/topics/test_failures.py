"""Rules in words for planted failures."""

import re
from dataclasses import replace

import numpy as np

from abhv_mc.topics.failures import FAILURES
from abhv_mc.topics.topic import Models

METRIC = "speed_error_max_mps"  # below 5


def rules_of(results, failed):
    """Return the rules, in words, of the flights of LQR that miss the limit of the speed error."""
    flights = results.flights["lqr"]
    metrics = {**flights.metrics, METRIC: np.where(failed[flights.flight], 9.0, 1.0)}
    results = replace(results, flights={"lqr": replace(flights, metrics=metrics)})
    kinds = Models(results)[FAILURES].controllers["lqr"]
    (kind,) = (entry for entry in kinds if "Speed" in entry.kind)
    return [rule.where for rule in kind.rules]


def test_a_difference_of_inputs_is_said_as_directions_with_an_example(flown):
    results = flown(80)
    density = (results.samples["atmosphere.density"] - 1.0) / 0.10
    drag = (results.samples["aero.drag"] - 1.0) / 0.15
    rule = rules_of(results, density - drag > 1.2)[0]
    assert re.search(r"\bdensity \w+ drag\b.*: high\b", rule)
    assert re.search(r"\([^)]*\bdensity \+[^)]*, drag \N{MINUS SIGN}", rule)
    both = rules_of(results, np.abs(density - drag) > 1.2)[0]
    assert "high or low" in both


def test_a_threshold_of_one_input_is_said_with_its_value(flown):
    results = flown(80)
    drag = results.samples["aero.drag"]
    assert re.match(r"drag above \+\d", rules_of(results, drag > 1.08)[0])
