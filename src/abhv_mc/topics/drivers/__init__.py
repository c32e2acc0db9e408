"""Drivers of the errors: rank regression coefficients and sensitivity indices."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.folder.controller_flights import distances, metric_sign
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.drivers import (
    FALSE_DISCOVERY_RATE,
    LEAST_COEFFICIENT,
    LEAST_SHARE,
    RankDrivers,
    given_data_indices,
    rank_drivers,
)
from abhv_mc.statistics.estimates import Interval
from abhv_mc.statistics.ranks import rank_largest
from abhv_mc.topics.formatting import parameter_doc, percent, spoken_name
from abhv_mc.topics.topic import (
    Cell,
    Fold,
    Names,
    Picture,
    Row,
    Section,
    Table,
    Text,
    Topic,
    figures_of,
    grouped,
    interval_cell,
)

# share of the flights in each of two groups, with the lowest and highest values of a parameter
_TENTH = 0.1
_FEWEST_OF_TENTH = 5  # minimum number of flights in a group with the lowest or highest values
_KEPT = 12  # maximum number of parameters stored per metric
# maximum number of analysed flights; enough to distinguish correlations of 0.05 from chance
_MOST_FLIGHTS = 5_000
_NAMED = 2  # maximum number of drivers per error in the summary
_LISTED = 4  # maximum number of drivers per error listed in the table

_SIGNS = ("\N{MINUS SIGN}", "+"), ("near its median", "high or low")
Ends = tuple[float, float, float]  # estimate, and lower and upper bound of its 95 % interval


@dataclass(frozen=True)
class Driver:
    """Coefficient of one parameter in the rank regression of an error."""

    parameter: str
    either_way: bool  # whether the regressor is the parameter's distance from its median
    srrc: Ends  # standardized rank regression coefficient
    p_value: float  # p-value of the hypothesis that the coefficient is zero
    driver: bool  # whether the parameter is a significant driver
    # parameter whose effect the flights cannot distinguish from the effect of this parameter
    moves_with: str | None


@dataclass(frozen=True)
class Share:
    """Share of the rank variance that a parameter explains beyond the regression."""

    parameter: str
    first: float  # first-order sensitivity index
    total: float  # total sensitivity index
    partner: str | None  # parameter with the strongest interaction


@dataclass(frozen=True)
class Swing:
    """Medians of a metric over the flights with a parameter's lowest and highest values."""

    parameter: str
    lowest: float
    highest: float


@dataclass(frozen=True)
class MetricDrivers:
    """Parameters that drive one metric."""

    explained: float  # share of the rank variance explained by the regression
    otherwise: tuple[Share, ...]  # parameters with non-monotonic effects, largest effect first
    parameters: tuple[Driver, ...]  # parameters with monotonic effects, largest effect first
    median: float = nan  # median of the metric over all flights
    swings: tuple[Swing, ...] = ()  # one swing for each significant parameter


@dataclass(frozen=True)
class ControllerDrivers:
    """Drivers of one controller's metrics; empty if there are too few flights."""

    metrics: Mapping[str, MetricDrivers]


@dataclass(frozen=True)
class Drivers:
    """Drivers of all controllers' metrics; empty if the campaign has no dispersions."""

    controllers: Mapping[str, ControllerDrivers]
    false_discovery_rate: float = FALSE_DISCOVERY_RATE


def compute_drivers(results: FlownCampaign) -> Drivers:
    """Return the drivers of every metric under every controller."""
    names = results.controllers if results.dispersed else ()
    return Drivers({name: ControllerDrivers(_coefficients(results, name)) for name in names})


def _coefficients(results: FlownCampaign, controller: str) -> dict[str, MetricDrivers]:
    metrics, names = list(results.metrics), list(results.dispersed)
    flights = results.flights[controller]
    first = np.arange(min(_MOST_FLIGHTS, flights.flight.size))
    outputs = np.column_stack(
        [
            metric_sign(flights.records[metric]) * distances(flights, metric, first)
            for metric in metrics
        ]
    )
    inputs, ordered, folded = [], [], []
    for name in names:
        sampled = results.samples[name]
        inputs.append(sampled[flights.flight[first]])
        # The numbers of categories have no order, so the regression gets constants.
        is_category = results.campaign.parameters[name].is_category
        ordered.append(np.zeros(len(first)) if is_category else inputs[-1])
        # Absolute errors often grow with a parameter's distance from its median.
        finite = sampled[flights.flight]
        # The time of a failure that does not occur is infinite.
        finite = finite[np.isfinite(finite)]
        folded.append(np.abs(ordered[-1] - (np.median(finite) if finite.size else 0.0)))
    drivers = rank_drivers(np.column_stack(ordered), outputs, folded=np.column_stack(folded))
    if drivers is None:
        return {}
    shares_by_metric = _given_data(results, np.column_stack(inputs), drivers)
    table = {}
    for column, metric in enumerate(metrics):
        if np.isfinite(drivers.explained[column]):
            order = rank_largest(np.abs(drivers.srrc[:, column]))[:_KEPT]
            parameters = tuple(_driver(drivers, names, row, column) for row in order)
            shares = shares_by_metric.get(metric, ())
            moving = [driver.parameter for driver in parameters if driver.driver]
            moving += [share.parameter for share in shares]
            values = flights.metrics[metric][first]
            worst = -np.inf if flights.records[metric].bad == "low" else np.inf
            values = np.where(flights.failed[first] | np.isnan(values), worst, values)
            swings = (
                find_swing(name, inputs[names.index(name)], values)
                for name in dict.fromkeys(moving)
                if not results.campaign.parameters[name].is_category
            )
            table[metric] = MetricDrivers(
                explained=float(drivers.explained[column]),
                otherwise=shares,
                parameters=parameters,
                median=_middle(values),
                swings=tuple(filter(None, swings)),
            )
    return table


def find_swing(parameter: str, sampled: Floats, values: Floats) -> Swing | None:
    """Return the medians of `values` over the flights with the lowest and highest samples.

    Each group contains a tenth of the flights or, if the parameter has few distinct values (for
    example, a rare failure), the nearest possible share. Return None if a group has too few flights
    or a median that is not finite.
    """
    low, high = np.quantile(sampled, [_TENTH, 1.0 - _TENTH], method="nearest")
    below, above = sampled <= low, sampled >= high
    if low == high:
        lower, higher = sampled < low, sampled > high
        below = lower if lower.sum() >= _FEWEST_OF_TENTH else below
        above = higher if higher.sum() >= _FEWEST_OF_TENTH else above
    if min(below.sum(), above.sum()) < _FEWEST_OF_TENTH or np.any(below & above):
        return None
    lowest, highest = _middle(values[below]), _middle(values[above])
    if not np.isfinite([lowest, highest]).all():
        return None
    return Swing(parameter, lowest, highest)


def _middle(values: Floats) -> float:
    """Return the median without interpolation, which would fail for infinite values."""
    return float(np.quantile(values, 0.5, method="nearest"))


def _driver(drivers: RankDrivers, names: list[str], row: int, column: int) -> Driver:
    partner = int(drivers.moves_with[row, column])
    tables = drivers.srrc, drivers.srrc_low, drivers.srrc_high
    value, low, high = (float(table[row, column]) for table in tables)
    return Driver(
        parameter=names[row % len(names)],
        either_way=row >= len(names),
        srrc=(value, low, high),
        p_value=float(drivers.p_value[row, column]),
        driver=bool(drivers.found[row, column]),
        moves_with=names[partner % len(names)] if partner >= 0 else None,
    )


def _given_data(
    results: FlownCampaign, inputs: Floats, drivers: RankDrivers
) -> dict[str, tuple[Share, ...]]:
    """Return the parameters with non-monotonic effects on required metrics, by effect size.

    The largest effect comes first. An effect is measured by the first-order and total sensitivity
    indices of the regression residuals. Parameters correlated with a driver are excluded. The
    flights must be random draws, because the regular order of other designs would appear as an
    effect.
    """
    names, metrics = list(results.dispersed), list(results.metrics)
    variance = drivers.residuals.var(axis=0)
    chosen = [
        c for c, name in enumerate(metrics) if name in results.asked and variance[c] > LEAST_SHARE
    ]
    indices = (
        given_data_indices(inputs, drivers.residuals[:, chosen])
        if chosen and results.campaign.independent
        else None
    )
    if indices is None:
        return {}
    both = (2, len(names), -1)  # axis 0: parameter values, then their distances from the medians
    partner = np.any((drivers.moves_with >= 0).reshape(both), axis=0)
    partner &= ~np.any(drivers.found.reshape(both), axis=0)
    selected = indices.found & ~partner[:, chosen]
    return {
        metrics[column]: tuple(
            Share(
                names[row],
                float(indices.first[row, index]),
                float(indices.total[row, index]),
                names[indices.partner[row, index]] if indices.partner[row, index] >= 0 else None,
            )
            for row in rank_largest(indices.total[:, index])
            if selected[row, index]
        )
        for index, column in enumerate(chosen)
    }


def driver_text(drivers: ControllerDrivers, names: Names) -> str:
    """Return the largest drivers of each leading error, with their directions, as text."""
    texts = []
    for metric in names.asked:
        if metric in drivers.metrics:
            entry = drivers.metrics[metric]
            # directions in which a parameter must change for the metric to grow
            largest = [
                f"{spoken_name(driver.parameter)} ({_SIGNS[driver.either_way][driver.srrc[0] > 0]})"
                for driver in entry.parameters
                if driver.driver
            ] + [spoken_name(share.parameter) for share in entry.otherwise]
            listed = ", ".join(largest[:_NAMED]) or "no single parameter"
            texts.append(f"{names.metrics[metric].phrase}: {listed}")
    return "; ".join(texts)


def driver_section(drivers: Drivers, names: Names) -> Section:
    """Return the section on the drivers of the leading errors."""
    groups = tuple(
        _group(names, name, metric, entry.metrics[metric])
        for name, entry in drivers.controllers.items()
        for metric in names.asked
        if metric in entry.metrics
    )
    title = "Drivers of the errors"
    if not groups:
        return Section(
            title,
            (Text("No drivers can be determined: too few flights or no dispersions."),),
            part=True,
        )
    rate = percent(drivers.false_discovery_rate, 1)
    method = (
        "The table lists the effects of the dispersed parameters on each error as standardized "
        'rank regression coefficients (SRRC), with bootstrap 95 % intervals. "High or low" denotes '
        'a parameter\'s distance from its median on either side. "Not monotonic" denotes an effect '
        "that the regression does not capture, as the share of the variance of ranks that the "
        "parameter explains alone and with other parameters (Gamboa et al. 2022; for pairs, from "
        "the variance between cells). Only significant effects are listed (false-discovery rate "
        f"{rate} over all parameters and metrics), and only those with an SRRC of at least "
        f"{LEAST_COEFFICIENT} or a share of at least {percent(LEAST_SHARE)}."
    )
    caption = (
        "Drivers of the errors, largest first, and the share of the variance of ranks that no "
        "single parameter explains"
    )
    heads = (names.kind, "Error", "Noise and interactions", "Driver", "SRRC")
    table = Fold(
        "Rank coefficients in full",
        (Text(method), Table("Drivers by metric", heads, groups, caption)),
    )
    return Section(title, (Picture("drivers"), table), part=True)


def _group(names: Names, controller: str, metric: str, entry: MetricDrivers) -> tuple[Row, ...]:
    """Return one table row for each driver of a metric."""
    rows = [_driver_row(driver, names) for driver in entry.parameters if driver.driver]
    rows += [_share_row(share, names) for share in entry.otherwise]
    first = Cell(names.label(controller), head=True), Cell(names.metrics[metric].label, head=True)
    return grouped(
        rows[:_LISTED] or [(Cell("no single parameter"), Cell(""))],
        *first,
        Cell(percent(1.0 - entry.explained, 2)),
    )


def _driver_row(driver: Driver, names: Names) -> Row:
    name = spoken_name(driver.parameter) + (", high or low" if driver.either_way else "")
    cell = Cell(
        name,
        f"confounded with {spoken_name(driver.moves_with)}" if driver.moves_with else "",
        hint=f"{driver.parameter}: {parameter_doc(driver.parameter, names.campaign.parameters)}",
    )
    return cell, interval_cell(Interval(*driver.srrc))


def _share_row(share: Share, names: Names) -> Row:
    is_category = names.campaign.parameters[share.parameter].is_category
    kind = "by category" if is_category else "not monotonic"
    note = f"mostly with {spoken_name(share.partner)}" if share.partner else ""
    shares = f"{percent(share.total, 2)} of the variance", f"{percent(share.first, 2)} alone"
    return Cell(f"{spoken_name(share.parameter)}, {kind}", note), Cell(*shares)


DRIVERS = Topic("drivers", Drivers, compute_drivers, driver_section, figures_of(__name__))
