"""The worst flights: what is told of each."""

from dataclasses import replace

import numpy as np
import pytest

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flight.outcome import Outcome
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.flights.model import worst_flights
from abhv_mc.topics.topic import Models


def test_worst_flights_have_their_three_largest_dispersions_in_sigma(flown):
    """All of them stood in one narrow cell: 24 in a campaign with so many."""
    models = Models(flown(80))
    widths = {"atmosphere.density": 0.1, "aero.lift": 0.1, "aero.drag": 0.15}
    samples = models.results.samples
    for entry in (entry for flights in models[FLIGHTS].worst.values() for entry in flights):
        sigmas = [abs(each.sigma) for each in entry.largest]
        assert len(sigmas) <= 3 and sigmas == sorted(sigmas, reverse=True)
        for each in entry.largest:
            column = samples[each.parameter]
            assert each.sigma == pytest.approx((each.value - column.mean()) / column.std())
            assert abs(each.value - 1.0) <= widths[each.parameter]
    table = next(table for table in models.section(FLIGHTS).tables() if table.title.startswith("Worst"))
    assert table.plain_rows()[0][-1].count(" sigma)") == 3


def test_a_settled_error_of_a_flight_lost_before_anything_settled_is_none(flown, monkeypatch):
    """It read 0: the best value in the table of the worst flights."""
    results = flown(80)
    flights = results.flights["tlc"]
    metric = next(name for name in flights.metrics if flights.records[name].settled)
    values = np.zeros(flights.flight.size)
    values[::2] = 1.5
    monkeypatch.setattr(Experiment, "asked", (metric,))

    def found(outcome):
        each = replace(flights, metrics={**flights.metrics, metric: values}, outcome=np.full(values.size, outcome))
        (entries, *_) = worst_flights(replace(results, flights={"tlc": each})).values()
        return {(entry.flight % 2, entry.metrics[metric]) for entry in entries}

    assert found(Outcome.OK) <= {(0, 1.5), (1, 0.0)}
    lost = found(Outcome.BANK_LIMIT)
    assert (0, 1.5) in lost and {number % 2 for number, value in lost if np.isnan(value)} == {1}
