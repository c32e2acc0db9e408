"""What moves the errors: rank coefficients of the dispersed parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.folder.controller_flights import distances
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.drivers import FALSE_DISCOVERY_RATE, RankDrivers, rank_drivers
from abhv_mc.statistics.estimates import Interval
from abhv_mc.statistics.given_data import given_data_indices
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import (
    Cell,
    Fold,
    Picture,
    Row,
    Section,
    Table,
    Text,
    grouped,
    interval_cell,
)
from abhv_mc.topics.topic import Topic, figures_of
from abhv_mc.topics.words import joined, parameter_doc, percent, spoken_name

_KEPT = 12  # parameters of a metric, largest first
_MOST_FLIGHTS = 5_000  # the first so many tell correlations of 0.05 from chance
_NAMED = 2  # drivers of an error in a sentence
_LISTED = 4  # in the table
_MOVED = 2  # controllers whose drivers are told

Ends = tuple[float, float, float]  # an estimate, the lower and the upper end of its 95 % interval


@dataclass(frozen=True)
class Driver:
    """A parameter's rank coefficients in an error."""

    parameter: str
    either_way: bool  # its distance from the median, not itself
    srrc: Ends  # standardized rank regression coefficient
    prcc: Ends  # partial rank correlation
    p_value: float
    driver: bool  # whether chance does not explain it
    moves_with: str | None  # another parameter that the flights do not tell apart from it


@dataclass(frozen=True)
class Share:
    """A parameter's share of the variance of ranks, where the relation is not monotonic."""

    parameter: str
    first: float  # alone
    total: float  # together with others
    partner: str | None  # with which it acts most


@dataclass(frozen=True)
class MetricDrivers:
    """What drives one metric."""

    explained: float  # share of the variation of ranks
    tells: bool  # whether that is enough for the coefficients to tell
    otherwise: tuple[Share, ...]  # largest first
    parameters: tuple[Driver, ...]  # largest first


@dataclass(frozen=True)
class ControllerDrivers:
    """What drives the metrics of one controller; none where its flights are too few."""

    metrics: Mapping[str, MetricDrivers]


@dataclass(frozen=True)
class Drivers:
    """What drives the metrics of all controllers; none without dispersions."""

    controllers: Mapping[str, ControllerDrivers]
    false_discovery_rate: float = FALSE_DISCOVERY_RATE


def compute_drivers(results: FlownCampaign) -> Drivers:
    """Rank coefficients of every metric."""
    names = results.controllers if results.dispersed else ()
    return Drivers({name: ControllerDrivers(_coefficients(results, name)) for name in names})


def _coefficients(results: FlownCampaign, controller: str) -> dict[str, MetricDrivers]:
    metrics, names = list(results.metrics), list(results.dispersed)
    flights = results.flights[controller]
    first = np.arange(min(_MOST_FLIGHTS, flights.flight.size))
    outputs = np.column_stack([distances(flights, metric, first) for metric in metrics])
    inputs, folded = [], []
    for sampled in map(results.samples.__getitem__, names):
        inputs.append(sampled[flights.flight[first]])
        # A largest absolute error often grows with a parameter's distance from its middle, whichever way; ranks of
        # the parameter alone do not see that.
        finite = sampled[flights.flight]
        finite = finite[np.isfinite(finite)]  # a failure that never comes is far from every time
        folded.append(np.abs(inputs[-1] - (np.median(finite) if finite.size else 0.0)))
    drivers = rank_drivers(np.column_stack([*inputs, *folded]), outputs)
    if drivers is None:
        return {}
    otherwise = _given_data(results, np.column_stack(inputs), outputs, drivers.tells)
    table = {}
    for column, metric in enumerate(metrics):
        if np.isfinite(drivers.explained[column]):
            order = np.argsort(-np.abs(np.nan_to_num(drivers.srrc[:, column])), kind="stable")[
                :_KEPT
            ]
            table[metric] = MetricDrivers(
                float(drivers.explained[column]),
                bool(drivers.tells[column]),
                otherwise.get(metric, ()),
                tuple(_driver(drivers, names, row, column) for row in order.tolist()),
            )
    return table


def _driver(drivers: RankDrivers, names: list[str], row: int, column: int) -> Driver:
    partner = int(drivers.moves_with[row, column])

    def ends(*tables: Floats) -> Ends:
        value, low, high = (float(table[row, column]) for table in tables)
        return value, low, high

    return Driver(
        names[row % len(names)],
        row >= len(names),
        ends(drivers.srrc, drivers.srrc_low, drivers.srrc_high),
        ends(drivers.prcc, drivers.prcc_low, drivers.prcc_high),
        float(drivers.p_value[row, column]),
        bool(drivers.found[row, column]),
        names[partner % len(names)] if partner >= 0 else None,
    )


def _given_data(
    results: FlownCampaign, inputs: Floats, outputs: Floats, tells: Mask
) -> dict[str, tuple[Share, ...]]:
    """Parameters that decide a headline error in another way than steadily up or down, largest first.

    By first-order and total indices from the flights, of metrics that the rank regression does not explain. Designs
    whose flights are no random draws have an order that these would take for an effect.
    """
    names, metrics = list(results.dispersed), list(results.metrics)
    chosen = [c for c, metric in enumerate(metrics) if metric in results.asked and not tells[c]]
    found = (
        given_data_indices(inputs, outputs[:, chosen])
        if chosen and results.campaign.independent
        else None
    )
    if found is None:
        return {}
    return {
        metrics[column]: tuple(
            Share(
                names[row],
                float(found.first[row, place]),
                float(found.total[row, place]),
                names[found.partner[row, place]] if found.partner[row, place] >= 0 else None,
            )
            for row in np.argsort(-found.total[:, place], kind="stable").tolist()
            if found.found[row, place]
        )
        for place, column in enumerate(chosen)
    }


def otherwise_words(shares: Sequence[Share]) -> list[str]:
    """'drag' of a parameter that acts alone, 'lift together with density' of two that mostly do not, each name once."""
    words: list[str] = []
    told: set[str] = set()
    for share in shares:
        if share.parameter in told:
            continue
        told.add(share.parameter)
        name = spoken_name(share.parameter)
        if (
            share.partner is not None
            and share.partner not in told
            and share.first < share.total / 2.0
        ):
            told.add(share.partner)
            name += f" together with {spoken_name(share.partner)}"
        words.append(name)
    return words


def driver_sentences(drivers: Drivers, names: Names) -> Sequence[str]:
    """What moves the errors of the first controllers most."""
    told = list(drivers.controllers.items())[:_MOVED]
    return [*filter(None, (_sentence(names.label(name), part, names) for name, part in told))]


def _sentence(label: str, drivers: ControllerDrivers, names: Names) -> str:
    """What moves each headline error of a controller most."""
    parts, none = [], []
    for metric in names.asked:
        if metric not in drivers.metrics:
            continue
        entry, phrase = drivers.metrics[metric], names.metrics[metric].phrase
        found = dict.fromkeys(
            spoken_name(each.parameter) for each in entry.parameters if each.driver
        )
        if words := (list(found) or otherwise_words(entry.otherwise))[:_NAMED]:
            parts.append(f"{phrase}: {joined(words)}")
        else:
            none.append(phrase)
    parts += [f"no single parameter moves {joined(none)}"] if none else []
    return f"What moves the errors of {label} most: {'; '.join(parts)}." if parts else ""


def driver_section(drivers: Drivers, names: Names) -> Section:
    """The drivers of the headline errors."""
    groups = tuple(
        _group(names, name, metric, part.metrics[metric])
        for name, part in drivers.controllers.items()
        for metric in names.asked
        if metric in part.metrics
    )
    title = "What moves the errors"
    if not groups:
        return Section(
            title,
            (Text("Too few flights, or nothing dispersed: no drivers can be told."),),
            part=True,
        )
    rate = percent(drivers.false_discovery_rate, 1)
    method = (
        "Which dispersed parameters move each error: standardized rank regression coefficients (SRRC) and partial "
        'rank correlations (PRCC) with 95 % intervals. "High or low" is a parameter\'s distance from its median, '
        "either side. Below 50 % explained the relation is not monotonic; first-order and total rank indices are given "
        "instead (Gamboa et al. 2022; pairs by the variance between cells of both). Listed are those that chance does "
        f"not explain (false-discovery rate {rate} over all parameters and metrics)."
    )
    caption = (
        "Drivers of the errors, largest first, and the share of the variation of ranks "
        "that all parameters explain"
    )
    heads = (names.campaign.kind.capitalize(), "Error", "Explained", "Driver", "SRRC", "PRCC")
    table = Fold(
        "Rank coefficients in full",
        (Text(method), Table("Drivers of the errors", heads, groups, caption)),
    )
    return Section(title, (Picture("drivers"), table), part=True)


def _group(names: Names, controller: str, metric: str, entry: MetricDrivers) -> tuple[Row, ...]:
    """A row for each driver."""
    rows = [_driver_row(each, names) for each in entry.parameters if each.driver][:_LISTED]
    first = Cell(names.label(controller), head=True), Cell(names.metrics[metric].label, head=True)
    return grouped(
        rows or [(Cell(_otherwise(entry), columns=3),)], *first, Cell(percent(entry.explained, 2))
    )


def _driver_row(driver: Driver, names: Names) -> Row:
    words = spoken_name(driver.parameter) + (", high or low" if driver.either_way else "")
    note = f"moves with {spoken_name(driver.moves_with)}" if driver.moves_with else ""
    name = Cell(
        words,
        note,
        hint=f"{driver.parameter}: {parameter_doc(driver.parameter, names.campaign.parameters)}",
    )
    return name, interval_cell(Interval(*driver.srrc)), interval_cell(Interval(*driver.prcc))


def _otherwise(entry: MetricDrivers) -> str:
    """'lift together with density, not steadily up or down: lift 4 % alone and 62 % in all, ...'."""
    if not entry.otherwise:
        return "no single parameter"
    shares = [
        f"{spoken_name(share.parameter)} {percent(share.first, 2)} alone, {percent(share.total, 2)} in all"
        for share in entry.otherwise[:_LISTED]
    ]
    names = joined(otherwise_words(entry.otherwise[:_LISTED]))
    return f"{names}, not steadily up or down (of the variance of ranks: {'; '.join(shares)})"


DRIVERS = Topic(
    "drivers", Drivers, compute_drivers, driver_section, driver_sentences, figures_of(__name__)
)
