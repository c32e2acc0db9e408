"""Why errors vary, in sentences and as a table."""

from collections.abc import Iterator, Sequence

from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.drivers.model import ControllerDrivers, Driver, Drivers, MetricDrivers, otherwise_words
from abhv_mc.topics.names import Names
from abhv_mc.topics.parameter_words import parameter_doc, spoken_name
from abhv_mc.topics.section import Cell, Fold, Picture, Row, Section, Table, Text, interval_cell
from abhv_mc.topics.words import joined, percent

_NAMED = 2  # drivers of an error in a sentence
_LISTED = 4  # in the table
_MOVED = 2  # controllers whose drivers are told


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
        found = dict.fromkeys(spoken_name(each.parameter) for each in entry.parameters if each.driver)
        if words := (list(found) or otherwise_words(entry.otherwise))[:_NAMED]:
            parts.append(f"{phrase}: {joined(words)}")
        else:
            none.append(phrase)
    parts += [f"no single parameter moves {joined(none)}"] if none else []
    return f"What moves the errors of {label} most: {'; '.join(parts)}." if parts else ""


def driver_section(drivers: Drivers, names: Names) -> Section:
    """The drivers of the headline errors."""
    groups = tuple(
        group
        for name, part in drivers.controllers.items()
        for metric in names.asked
        if metric in part.metrics
        for group in _group(names, name, metric, part.metrics[metric])
    )
    title = "What moves the errors"
    if not groups:
        return Section(title, (Text("Too few flights, or nothing dispersed: no drivers can be told."),), part=True)
    rate = percent(drivers.false_discovery_rate, 1)
    method = (
        "Which dispersed parameters move each error: standardized rank regression coefficients (SRRC) and partial "
        'rank correlations (PRCC) with 95 % intervals. "High or low" is a parameter\'s distance from its median, '
        "either side. Below 50 % explained the relation is not monotonic; first-order and total rank indices are given "
        "instead (Gamboa et al. 2022; pairs by the variance between cells of both). Listed are those that chance does "
        f"not explain (false-discovery rate {rate} over all parameters and metrics)."
    )
    caption = (
        "Drivers of the errors, largest first, and the share of the variation of ranks that all parameters explain"
    )
    heads = (names.kind.capitalize(), "Error", "Explained", "Driver", "SRRC", "PRCC")
    table = Fold("Rank coefficients in full", (Text(method), Table("Drivers of the errors", heads, groups, caption)))
    return Section(title, (Picture("drivers"), table), part=True)


def _group(names: Names, controller: str, metric: str, entry: MetricDrivers) -> Iterator[tuple[Row, ...]]:
    """A row for each driver."""
    listed = [each for each in entry.parameters if each.driver][:_LISTED]
    label, error = names.label(controller), names.metrics[metric].label
    explained, count = percent(entry.explained, 2), max(1, len(listed))
    first = Cell(label, rows=count, head=True), Cell(error, rows=count, head=True), Cell(explained, rows=count)
    if not listed:
        yield ((*first, Cell(_otherwise(entry), columns=3)),)
        return
    rows = [_driver_row(each, names) for each in listed]
    yield ((*first, *rows[0]), *rows[1:])


def _driver_row(driver: Driver, names: Names) -> Row:
    words = spoken_name(driver.parameter) + (", high or low" if driver.either_way else "")
    note = f"moves with {spoken_name(driver.moves_with)}" if driver.moves_with else ""
    name = Cell(words, note, hint=f"{driver.parameter}: {parameter_doc(driver.parameter, names.parameters)}")
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
