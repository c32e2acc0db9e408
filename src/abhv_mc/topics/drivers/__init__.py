"""What moves the errors: rank coefficients of the dispersed parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.folder.controller_flights import distances, metric_sign
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.statistics.drivers import (
    FALSE_DISCOVERY_RATE,
    LEAST_COEFFICIENT,
    RankDrivers,
    rank_drivers,
)
from abhv_mc.statistics.estimates import Interval
from abhv_mc.statistics.given_data import LEAST_SHARE, given_data_indices
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

_TENTH = 0.1  # of the flights
_FEWEST_OF_TENTH = 5  # flights
_KEPT = 12  # parameters of a metric, largest first
_MOST_FLIGHTS = 5_000  # the first so many tell correlations of 0.05 from chance
_NAMED = 2  # drivers of an error in a sentence
_LISTED = 4  # in the table
_MOVED = 2  # controllers whose drivers are told
_NOISY = 0.5  # share that the regression leaves, from which a sentence gives it

Ends = tuple[float, float, float]  # an estimate, the lower and the upper end of its 95 % interval


@dataclass(frozen=True)
class Driver:
    """A parameter's rank coefficients in an error."""

    parameter: str
    either_way: bool  # its distance from the median, not itself
    srrc: Ends  # standardized rank regression coefficient
    p_value: float  # of a zero coefficient
    driver: bool  # whether chance does not explain it
    moves_with: str | None  # another parameter that the flights do not tell apart from it


@dataclass(frozen=True)
class Share:
    """A parameter's share of the variance of ranks that the regression does not explain."""

    parameter: str
    first: float  # alone
    total: float  # together with others
    partner: str | None  # with which it acts most


@dataclass(frozen=True)
class Swing:
    """Medians of a metric over the tenths of the flights in which a parameter is lowest and highest."""

    parameter: str
    lowest: float
    highest: float


@dataclass(frozen=True)
class MetricDrivers:
    """What drives one metric."""

    explained: float  # share of the variation of ranks
    otherwise: tuple[Share, ...]  # not monotonic, largest first
    parameters: tuple[Driver, ...]  # largest first
    median: float = nan  # over all flights
    swings: tuple[Swing, ...] = ()  # of each parameter that chance does not explain


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
    outputs = np.column_stack(
        [
            metric_sign(flights.records[metric]) * distances(flights, metric, first)
            for metric in metrics
        ]
    )
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
    otherwise = _given_data(results, np.column_stack(inputs), drivers)
    table = {}
    for column, metric in enumerate(metrics):
        if np.isfinite(drivers.explained[column]):
            order = np.argsort(-np.abs(np.nan_to_num(drivers.srrc[:, column])), kind="stable")[
                :_KEPT
            ]
            parameters = tuple(_driver(drivers, names, row, column) for row in order.tolist())
            shares = otherwise.get(metric, ())
            moving = [each.parameter for each in parameters if each.driver]
            moving += [each.parameter for each in shares]
            values = flights.metrics[metric][first]
            worst = -np.inf if flights.records[metric].bad == "low" else np.inf
            values = np.where(flights.failed[first] | np.isnan(values), worst, values)
            swings = (
                find_swing(name, inputs[names.index(name)], values)
                for name in dict.fromkeys(moving)
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
    """Return the medians of `values` [flight] at the lowest and highest tenth of `sampled`.

    A parameter of few values, such as a failure that most flights have not, is divided at the tenth as far as its
    values allow. None if a side has too few flights, or a median that is not finite.
    """
    low, high = np.quantile(sampled, [_TENTH, 1.0 - _TENTH], method="nearest")
    if low == high:
        below, above = sampled < low, sampled > high
        below, above = (
            below if below.sum() >= _FEWEST_OF_TENTH else sampled <= low,
            above if above.sum() >= _FEWEST_OF_TENTH else sampled >= high,
        )
    else:
        below, above = sampled <= low, sampled >= high
    if min(below.sum(), above.sum()) < _FEWEST_OF_TENTH or np.any(below & above):
        return None
    lowest, highest = _middle(values[below]), _middle(values[above])
    if not np.isfinite([lowest, highest]).all():
        return None
    return Swing(parameter, lowest, highest)


def _middle(values: Floats) -> float:
    """Return the median, one of the values: between a number and infinity there is none."""
    return float(np.quantile(values, 0.5, method="nearest"))


def _driver(drivers: RankDrivers, names: list[str], row: int, column: int) -> Driver:
    partner = int(drivers.moves_with[row, column])

    def ends(*tables: Floats) -> Ends:
        value, low, high = (float(table[row, column]) for table in tables)
        return value, low, high

    return Driver(
        parameter=names[row % len(names)],
        either_way=row >= len(names),
        srrc=ends(drivers.srrc, drivers.srrc_low, drivers.srrc_high),
        p_value=float(drivers.p_value[row, column]),
        driver=bool(drivers.found[row, column]),
        moves_with=names[partner % len(names)] if partner >= 0 else None,
    )


def _given_data(
    results: FlownCampaign, inputs: Floats, drivers: RankDrivers
) -> dict[str, tuple[Share, ...]]:
    """Return parameters with an effect on a required metric that is not monotonic, largest first.

    First-order and total indices of the residuals of the regression, but of parameters that are correlated with one
    that it finds. Designs whose flights are no random draws have an order that these would take for an effect.
    """
    names, metrics = list(results.dispersed), list(results.metrics)
    left = 1.0 - drivers.explained
    chosen = [
        c for c, name in enumerate(metrics) if name in results.asked and left[c] > LEAST_SHARE
    ]
    indices = (
        given_data_indices(inputs, drivers.residuals[:, chosen])
        if chosen and results.campaign.independent
        else None
    )
    if indices is None:
        return {}
    both = (2, len(names), -1)  # the parameters, and their distances from the median
    partner = np.any((drivers.moves_with >= 0).reshape(both), axis=0)
    partner &= ~np.any(drivers.found.reshape(both), axis=0)
    first, total = indices.first * left[chosen], indices.total * left[chosen]
    found = indices.found & ~partner[:, chosen] & (total > LEAST_SHARE)
    return {
        metrics[column]: tuple(
            Share(
                names[row],
                float(first[row, place]),
                float(total[row, place]),
                names[indices.partner[row, place]] if indices.partner[row, place] >= 0 else None,
            )
            for row in np.argsort(-total[:, place], kind="stable").tolist()
            if found[row, place]
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
        signs: dict[str, str] = {}
        for driver in (each for each in entry.parameters if each.driver):
            signs.setdefault(spoken_name(driver.parameter), _sign(driver))
        words = [f"{name} ({sign})" for name, sign in signs.items()]
        words += otherwise_words(
            [s for s in entry.otherwise if spoken_name(s.parameter) not in signs]
        )
        rest = f" (noise and interactions: {percent(1.0 - entry.explained, 2)})"
        noise = rest if 1.0 - entry.explained > _NOISY and not entry.otherwise else ""
        more = [f"{len(words) - _NAMED} more"] if len(words) > _NAMED else []
        if words:
            parts.append(f"{phrase}: {joined([*words[:_NAMED], *more])}{noise}")
        else:
            none.append(phrase + noise)
    parts += [f"no single parameter moves {joined(none)}"] if none else []
    return f"What moves the errors of {label} most: {'; '.join(parts)}." if parts else ""


def _sign(driver: Driver) -> str:
    """Return the direction in which the metric grows."""
    if driver.either_way:
        return "high or low" if driver.srrc[0] > 0.0 else "near its median"
    return "+" if driver.srrc[0] > 0.0 else "\N{MINUS SIGN}"


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
        "Which dispersed parameters move each error: standardized rank regression coefficients (SRRC), with bootstrap "
        '95 % intervals. "High or low" is a parameter\'s distance from its median, either side. "Not monotonic" is '
        "what the regression leaves: a parameter's share of the variance of ranks, alone and with "
        "others (Gamboa et al. 2022; pairs by the variance between cells of both). Listed are those that chance does "
        f"not explain (false-discovery rate {rate} over all parameters and metrics). Parameters with an SRRC below "
        f"{LEAST_COEFFICIENT} or a share below {percent(LEAST_SHARE)} are not listed."
    )
    caption = (
        "Drivers of the errors, largest first, and the share of the variance of ranks that no parameter explains "
        "by itself"
    )
    heads = (names.campaign.kind.capitalize(), "Error", "Noise and interactions", "Driver", "SRRC")
    table = Fold(
        "Rank coefficients in full",
        (Text(method), Table("Drivers of the errors", heads, groups, caption)),
    )
    return Section(title, (Picture("drivers"), table), part=True)


def _group(names: Names, controller: str, metric: str, entry: MetricDrivers) -> tuple[Row, ...]:
    """A row for each driver."""
    rows = [_driver_row(each, names) for each in entry.parameters if each.driver]
    rows += [_share_row(share) for share in entry.otherwise]
    first = Cell(names.label(controller), head=True), Cell(names.metrics[metric].label, head=True)
    return grouped(
        rows[:_LISTED] or [(Cell("no single parameter"), Cell(""))],
        *first,
        Cell(percent(1.0 - entry.explained, 2)),
    )


def _driver_row(driver: Driver, names: Names) -> Row:
    words = spoken_name(driver.parameter) + (", high or low" if driver.either_way else "")
    note = f"moves with {spoken_name(driver.moves_with)}" if driver.moves_with else ""
    name = Cell(
        words,
        note,
        hint=f"{driver.parameter}: {parameter_doc(driver.parameter, names.campaign.parameters)}",
    )
    return name, interval_cell(Interval(*driver.srrc))


def _share_row(share: Share) -> Row:
    note = f"mostly with {spoken_name(share.partner)}" if share.partner else ""
    shares = f"{percent(share.total, 2)} of the variance", f"{percent(share.first, 2)} alone"
    return Cell(f"{spoken_name(share.parameter)}, not monotonic", note), Cell(*shares)


DRIVERS = Topic(
    "drivers", Drivers, compute_drivers, driver_section, driver_sentences, figures_of(__name__)
)
