"""Drivers of errors in a report, monotonic and not."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.campaign.file.config import Sampling
from abhv_mc.topics.drivers import (
    ControllerDrivers,
    Driver,
    Drivers,
    MetricDrivers,
    Share,
    Swing,
    _given_data,
    compute_drivers,
    driver_section,
    driver_text,
    find_swing,
)
from abhv_mc.topics.drivers.figures import draw, make_tornado
from abhv_mc.topics.topic import Models, Table

METRIC = "altitude_error_max_m"
PRODUCT = [("aero.drag", "atmosphere.density"), ("atmosphere.density", "aero.drag")]


@pytest.fixture
def results(flown):
    return flown(600)


def changed_drivers(results, error):
    """Return drivers of TLC for an altitude error that is a function of the samples."""
    values = {name: (column - 1.0) / 0.1 for name, column in results.samples.items()}
    flights = results.flights["tlc"]
    metrics = {name: flights.metrics[name] for name in results.metrics} | {METRIC: error(values)}
    return compute_drivers(replace(results, flights={"tlc": replace(flights, metrics=metrics)}))


def driver_names(results, error):
    return names_of(changed_drivers(results, error))


def names_of(drivers):
    """Return names of the drivers of the regression and of the residual."""
    entry = drivers.controllers["tlc"].metrics[METRIC]
    return [e.parameter for e in entry.parameters if e.driver], [
        (share.parameter, share.partner if share.first < share.total / 2.0 else None)
        for share in entry.otherwise
    ]


def test_a_wave_and_a_product_are_told(results):
    """Regression: sin(6x) and x0 x2 were reported as 'no single parameter'."""
    wave = driver_names(results, lambda x: 2.0 + np.sin(6.0 * x["aero.lift"]))
    assert wave == (["aero.lift"], [("aero.lift", None)])
    parameters, names = driver_names(
        results, lambda x: 2.0 + x["atmosphere.density"] * x["aero.drag"]
    )
    assert parameters == [] and sorted(names) == PRODUCT


def test_what_the_regression_tells_is_not_told_twice(results):
    assert driver_names(results, lambda x: np.exp(x["aero.lift"])) == (["aero.lift"], [])


def test_signs_are_those_of_the_metric_if_small_values_are_bad(results):
    """Regression: the sign was that of the severity, not of the metric."""
    flights = results.flights["tlc"]
    records = {**flights.records, METRIC: replace(flights.records[METRIC], bad="low")}
    changed = replace(flights, records=records)
    low = replace(results, flights={**results.flights, "tlc": changed})
    entry = changed_drivers(low, lambda x: x["aero.lift"]).controllers["tlc"].metrics[METRIC]
    (lift,) = (driver for driver in entry.parameters if driver.driver)
    assert lift.parameter == "aero.lift" and 0.9 < lift.srrc[1] <= lift.srrc[0] <= lift.srrc[2]


def test_lost_flights_are_the_worst_of_a_metric_whose_small_values_are_bad(results):
    flights = results.flights["tlc"]
    records = {**flights.records, METRIC: replace(flights.records[METRIC], bad="low")}
    outcome = np.where(np.arange(600) % 10 < 3, 3, 0)
    changed = replace(flights, records=records, outcome=outcome)
    low = replace(results, flights={**results.flights, "tlc": changed})

    def error(x):
        return 9.0 + 0.5 * x["atmosphere.density"] - 2.0 * x["aero.lift"]

    entry = changed_drivers(low, error).controllers["tlc"].metrics[METRIC]
    values = error({name: (column - 1.0) / 0.1 for name, column in results.samples.items()})
    assert entry.median == pytest.approx(np.median(np.where(outcome, -np.inf, values)), abs=0.02)
    # The largest coefficient comes first, whatever its sign.
    assert entry.parameters[0].parameter == "aero.lift"


def test_a_driver_has_its_sign_and_a_product_remains_beside_it(results):
    """Regression and residual each have their drivers, in one column of the table."""

    def error(x):
        product = x["atmosphere.density"] * x["aero.drag"]
        return 4.0 - 0.8 * x["aero.lift"] + product

    drivers = changed_drivers(results, error)
    parameters, others = names_of(drivers)
    assert parameters == ["aero.lift"] and sorted(others) == PRODUCT
    section = driver_section(drivers, Models(results).names)
    (table,) = [item for item in section.items[1].items if isinstance(item, Table)]
    rows = [row for row in table.plain_rows() if row[0] == "TLC" and row[1].startswith("Altitude")]
    assert rows[0][3].split(" (")[0] == "lift"
    assert all(re.search(r"\d\s?%", row[4]) for row in rows[1:]) and len(rows) == 3
    text = driver_text(drivers.controllers["tlc"], Models(results).names)
    assert "altitude error: lift (\N{MINUS SIGN}), d" in text


def test_designs_that_are_no_random_draws_have_no_such_indices(results):
    model = results.campaign.model.model_copy(update={"sampling": Sampling(design="corners")})
    facts = replace(results.campaign, model=model)
    error = replace(results, campaign=facts), lambda x: 2.0 + np.sin(6.0 * x["aero.lift"])
    assert driver_names(*error)[1] == []


def test_a_swing_is_of_the_tenths_of_the_flights_with_the_lowest_and_highest_values(results):
    """A parabola has both ends on one side of the median; a tenth's median is at 5 and 95 %."""
    drivers = changed_drivers(results, lambda x: 2.0 + x["aero.lift"] ** 2 + 0.5 * x["aero.drag"])
    entry = drivers.controllers["tlc"].metrics[METRIC]
    swings = {swing.parameter: swing for swing in entry.swings}
    lift = (results.samples["aero.lift"] - 1.0) / 0.1
    drag = (results.samples["aero.drag"] - 1.0) / 0.1
    values = 2.0 + lift**2 + 0.5 * drag
    ends = np.quantile(lift, [0.1, 0.9])
    for median, chosen in (
        (swings["aero.lift"].lowest, lift <= ends[0]),
        (swings["aero.lift"].highest, lift >= ends[1]),
    ):
        assert median == pytest.approx(np.median(values[chosen]), abs=0.02)
        assert median > entry.median
    assert entry.median == pytest.approx(np.median(values), abs=0.02)
    assert swings["aero.drag"].lowest < entry.median < swings["aero.drag"].highest


def test_a_swing_of_few_values_and_of_lost_flights():
    failure = np.repeat([0.0, 1.0], [95, 5])
    assert find_swing("p", failure, 2.0 + failure) == Swing("p", 2.0, 3.0)
    assert find_swing("p", np.repeat([0.0, 1.0], [97, 3]), failure) is None
    assert find_swing("p", np.ones(100), failure) is None
    lost = np.where(np.arange(100) > 92, np.inf, 1.0)
    assert find_swing("p", np.arange(100.0), lost) is None
    assert find_swing("p", -np.arange(100.0), lost) is None


def test_a_tornado_has_the_largest_drivers_of_any_controller_first(results):
    ((text, figure),) = draw(compute_drivers(results), Models(results).names)
    assert text.name == "drivers" and any(axes.get_visible() for axes in figure.axes)
    lift, drag, density = "aero.lift", "aero.drag", "atmosphere.density"
    swings = {name: Swing(name, 1.0, 2.0) for name in (lift, drag, density)}
    entry = MetricDrivers(
        explained=0.2,
        otherwise=(Share(lift, 0.1, 0.9, None), Share(drag, 0.3, 0.4, None)),
        parameters=(),
        median=1.5,
        swings=(swings[lift], swings[drag]),
    )
    driver = Driver(density, True, (-0.95, -1.0, -0.9), 0.0, True, None)
    other = MetricDrivers(0.9, (), (driver,), median=2.5, swings=(swings[density],))
    chart = make_tornado("Error (m)", [entry, other, None], (3.0,))
    assert chart.parameters == ["density", "lift", "drag"]
    assert chart.swings[0] == [None, swings[density], None]
    assert chart.swings[1] == [swings[lift], None, None]
    assert chart.medians[:2] == [1.5, 2.5] and np.isnan(chart.medians[2])


def test_categories_have_no_order(results):
    """A monotonic effect of the number of a category is no coefficient but a share."""
    parameters = results.campaign.parameters
    records = tuple(replace(r, is_category=r.name == "aero.lift") for r in parameters.records)
    contents = replace(results.campaign.contents, parameters=replace(parameters, records=records))
    campaign = replace(results.campaign, contents=contents)
    members = np.round(4.0 * results.samples["aero.lift"], 1)
    samples = {**results.samples, "aero.lift": members}
    changed = replace(results, campaign=campaign, samples=samples)
    assert driver_names(results, lambda x: 2.0 + x["aero.lift"])[0] == ["aero.lift"]
    found = driver_names(changed, lambda x: 2.0 + np.round(x["aero.lift"], 6))
    assert found == ([], [("aero.lift", None)])


@pytest.mark.parametrize(
    ("moving", "found", "share"),
    [((), (), 1), ([0], (), 0), ([2], (), 0), ([2], [0], 1), ([1, 3], (), 1)],
)
def test_parameters_that_move_with_a_driver_have_no_share(moving, found, share):
    """Of the first metric, a wave of parameter a remains; rows are values, then distances."""
    inputs = np.random.default_rng(1).uniform(-1.0, 1.0, (600, 2))
    wave = np.sin(6.0 * inputs[:, 0])
    residuals = np.column_stack([wave, 1e-3 * wave, wave])
    moves_with, drivers = np.full((4, 3), -1), np.zeros((4, 3), bool)
    moves_with[moving, 0], drivers[found, 0] = 1, True
    results = SimpleNamespace(
        dispersed=("a", "b"),
        metrics=("m", "explained", "not_asked"),
        asked=("explained", "m"),
        campaign=SimpleNamespace(independent=True),
    )
    ranks = SimpleNamespace(residuals=residuals, moves_with=moves_with, found=drivers)
    shares = _given_data(results, inputs, ranks)
    assert {name: [x.parameter for x in own] for name, own in shares.items()} == {
        "m": ["a"] * share
    }


def test_every_driver_has_its_cells(flown):
    """The table has at most four drivers of an error, and the text two."""
    names = Models(flown(80)).names
    parameters = names.campaign.parameters
    records = tuple(replace(r, is_category=r.name == "aero.drag") for r in parameters.records)
    contents = replace(names.campaign.contents, parameters=replace(parameters, records=records))
    names = replace(names, campaign=replace(names.campaign, contents=contents))
    lift, drag, density = "aero.lift", "aero.drag", "atmosphere.density"
    altitude, sideslip, speed = sorted(names.asked)

    def driver(name, value, either_way=False, driver=True, moves_with=None):
        ends = (value, value - 0.02, value + 0.02)
        return Driver(name, either_way, ends, 0.001, driver, moves_with)

    many = MetricDrivers(
        explained=0.754,
        otherwise=(Share(lift, 0.02, 0.31, density), Share(drag, 0.1, 0.2, None)),
        parameters=(
            driver(density, -0.81, moves_with=lift),
            driver(lift, 0.52, either_way=True),
            driver(drag, 0.1, driver=False),
            driver(drag, -0.4, either_way=True),
        ),
    )
    none = MetricDrivers(0.05, (), (driver(lift, 0.3, driver=False),))
    one = MetricDrivers(0.9, (), (driver(drag, 0.9), driver(lift, -0.2)))
    tlc = ControllerDrivers({altitude: many, sideslip: none})
    found = Drivers({"tlc": tlc, "lqr": ControllerDrivers({speed: one})}, 0.03)
    section = driver_section(found, names)
    (table,) = section.tables()
    thin, minus = "\u202f", "\N{MINUS SIGN}"
    first = ["TLC", "Altitude error, max", f"25{thin}%"]
    last = ["LQR", "Speed error, max", f"10{thin}%"]
    assert table.plain_rows() == [
        [*first, "density (confounded with lift)", f"{minus}0.81 ({minus}0.83 to {minus}0.79)"],
        [*first, "lift, high or low", "0.52 (0.50 to 0.54)"],
        [*first, "drag, high or low", f"{minus}0.40 ({minus}0.42 to {minus}0.38)"],
        [*first, "lift, not monotonic (mostly with density)",
         f"31{thin}% of the variance (2{thin}% alone)"],
        ["TLC", "Sideslip, max", f"95{thin}%", "no single parameter", ""],
        [*last, "drag", "0.90 (0.88 to 0.92)"],
        [*last, "lift", f"{minus}0.200 ({minus}0.220 to {minus}0.180)"],
    ]  # fmt: skip
    share = Share(drag, 0.1, 0.2, None)
    few = Drivers({"tlc": ControllerDrivers({altitude: replace(none, otherwise=(share,))})})
    assert driver_section(few, names).tables()[0].plain_rows()[0][3] == "drag, by category"
    text = {
        own.partition(": ")[0]: own.partition(": ")[2]
        for own in driver_text(tlc, names).split("; ")
    }
    assert text == {
        "max altitude error": f"density ({minus}), lift (high or low)",
        "max sideslip": "no single parameter",
    }
    signs = replace(many, parameters=many.parameters[3:])
    text = driver_text(ControllerDrivers({altitude: signs, speed: one}), names)
    assert text.split("; ") == [
        "max altitude error: drag (near its median), lift",
        f"max speed error: drag (+), lift ({minus})",
    ]
    assert driver_section(Drivers({"tlc": ControllerDrivers({})}), names).tables() == []
    assert section.part
