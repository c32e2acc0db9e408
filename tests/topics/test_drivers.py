"""What drives an error in a report, beyond what moves it steadily up or down."""

from dataclasses import replace

import numpy as np
import pytest

from abhv_mc.campaign.file.config import Sampling
from abhv_mc.topics.drivers import Driver, MetricDrivers, Share, compute_drivers, otherwise_words
from abhv_mc.topics.drivers.figures import _bars, draw
from abhv_mc.topics.topic import Models

METRIC = "altitude_error_max_m"


@pytest.fixture
def results(flown):
    return flown(600)


def told_of(results, error):
    """What the report tells of an altitude error of these samples."""
    values = {name: (column - 1.0) / 0.1 for name, column in results.samples.items()}
    flights = results.flights["tlc"]
    metrics = {name: flights.metrics[name] for name in results.metrics} | {METRIC: error(values)}
    changed = replace(
        results, flights={**results.flights, "tlc": replace(flights, metrics=metrics)}
    )
    entry = compute_drivers(changed).controllers["tlc"].metrics[METRIC]
    return [e.parameter for e in entry.parameters if e.driver], otherwise_words(entry.otherwise)


def test_a_wave_and_a_product_are_told(results):
    """sin(6x) and x0 x2 were 'no single parameter': no rank correlation sees them."""
    assert told_of(results, lambda x: 2.0 + np.sin(6.0 * x["aero.lift"])) == ([], ["lift"])
    found, words = told_of(results, lambda x: 2.0 + x["atmosphere.density"] * x["aero.drag"])
    assert found == [] and words in (["density together with drag"], ["drag together with density"])


def test_what_the_regression_tells_is_not_told_twice(results):
    assert told_of(results, lambda x: np.exp(x["aero.lift"])) == (["aero.lift"], [])


def test_designs_that_are_no_random_draws_have_no_such_indices(results):
    model = results.campaign.model.model_copy(update={"sampling": Sampling(design="corners")})
    facts = replace(results.campaign, model=model)
    assert told_of(
        replace(results, campaign=facts), lambda x: 2.0 + np.sin(6.0 * x["aero.lift"])
    ) == ([], [])


def test_each_parameter_is_named_once():
    def entry(name, partner, first):
        return Share(name, first, 0.6, partner)

    density, lift, drag = "atmosphere.density", "aero.lift", "aero.drag"
    assert otherwise_words(
        [entry(density, lift, 0.1), entry(lift, density, 0.1), entry(drag, density, 0.0)]
    ) == [
        "density together with lift",
        "drag",
    ]
    assert otherwise_words([entry(density, lift, 0.5), entry(lift, density, 0.1)]) == [
        "density",
        "lift",
    ]


def test_a_tornado_has_the_largest_drivers_of_any_controller_first(results):
    """A controller whose error has no monotonic relation shows shares of the variance of ranks."""
    drivers = compute_drivers(results)
    names = Models(results).names
    ((text, figure),) = draw(drivers, names)
    assert text.name == "drivers" and len(figure.axes) == len(drivers.controllers)
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    for metric in names.asked:
        assert names.metrics[metric].label in labels
    entry = MetricDrivers(
        0.2, False, (Share("aero.lift", 0.1, 0.9, None), Share("aero.drag", 0.3, 0.4, None)), ()
    )
    density = Driver(
        "atmosphere.density", True, (-0.95, -1.0, -0.9), (0.0, 0.0, 0.0), 0.0, True, None
    )
    bars = _bars([entry, MetricDrivers(0.9, True, (), (density,)), None])
    assert [(bar.label, bar.effects) for bar in bars] == [
        ("density, high or low", [None, (-0.95, -1.0, -0.9), None]),
        ("lift", [(0.9, 0.1, 0.9), None, None]),
        ("drag", [(0.4, 0.3, 0.4), None, None]),
    ]
    assert all(bar.shares == [True, False, False] for bar in bars)
