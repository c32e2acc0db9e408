"""Queries for the browser view: counts in bins, lists, single flights and CSV.

SQL statements contain only column names and parameters; no text from the browser becomes SQL.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter

from abhv_mc.folder.flown_campaign import FlownCampaign, read_flown
from abhv_mc.folder.tables import open_database
from abhv_mc.io.messages import InputError, describe, one_of, quoted
from abhv_mc.report.pages.flights_view import BARS, CELLS, LISTED, describe_flights
from abhv_mc.topics.figure_style import controller_colors
from abhv_mc.topics.formatting import axis_unit
from abhv_mc.topics.missed_requirements import requirement_failures
from abhv_mc.topics.topic import full_labels

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

# maximum number of individually plotted points; more points are counted in cells
MOST_POINTS = 4000
_ROWS = 10_000  # number of rows fetched at a time
_SHARES = {
    "all": "",
    "failed": "and outcome <> 'ok'",
    "ok": "and outcome = 'ok'",
}  # SQL conditions of the outcome filters; each requirement adds a further filter
# columns of the rank and worst metric; unlike names of metrics, their names contain spaces
_RANK = '"its rank"'
_BY = "worst in"
# columns, besides the numeric columns, by which the list can be sorted
_SORTED = {"rank": _RANK, "flight": "flight", "controller": "controller", "outcome": "outcome"}


@dataclass(frozen=True)
class Selection:
    """Selection shown in the view: two columns, and the flights within all brushes."""

    x: str
    y: str
    controllers: tuple[str, ...]
    outcome: str
    brushes: dict[str, tuple[float, float]]  # inclusive range of values, by column
    fit: bool = False  # whether to fit the axes to the selected flights
    sort: str = "rank"  # sort key of the list
    down: bool = False  # whether the order is descending


@dataclass(frozen=True)
class FlightTable:
    """In-memory database of flights, with a description of the view."""

    connection: "DuckDBPyConnection"
    ranges: Mapping[str, tuple[float, float]]  # range of the axis, by column
    view: dict[str, Any]
    results: FlownCampaign = field(repr=False)

    def cursor(self) -> "DuckDBPyConnection":
        """Return a new connection to the same tables, for the thread of a request."""
        return self.connection.cursor()

    @property
    def order(self) -> dict[str, int]:
        """Index of each controller in the order of the campaign."""
        return {entry["name"]: k for k, entry in enumerate(self.view["controllers"])}


@contextmanager
def open_flights(root: Path) -> Iterator[FlightTable]:
    """Load the flights of a results folder. Raise InputError if it is invalid."""
    results = read_flown(root)
    names = results.controllers
    columns = [*results.metrics, *results.dispersed]
    with open_database(root) as connection:
        connection.register("ranks", _ranks(results))
        scales = {
            name: axis_unit(name, results.campaign.parameters)[1] for name in results.dispersed
        }
        listed = ", ".join(
            f"{_quoted(name)} * {scales.get(name, 1.0)!r} as {_quoted(name)}" for name in columns
        )
        enum_names = ", ".join("'" + name.replace("'", "''") + "'" for name in names)
        connection.execute(
            f"create type controllers as enum ({enum_names})"
        )  # Queries of enumerations are three times as fast as queries of text.
        connection.execute(
            "create table shown as select controller::controllers as controller, flight, "
            "replace(outcome::varchar, '_', ' ') as outcome, ranks.* exclude (controller, flight), "
            f"{listed} from flights join ranks using (controller, flight)"
        )
        connection.unregister("ranks")
        query = f"select count(*), {', '.join(map(_ends, columns))} from shown"
        total, *extremes = connection.execute(query).fetchone() or (0,)
        ends = dict(zip(columns, zip(extremes[::2], extremes[1::2], strict=True), strict=True))
        labels = full_labels(results.folder, names)
        colors = controller_colors(names)
        channels = [channel.name for channel in results.campaign.channels]
        view = describe_flights(results, labels, colors, ends, channels)
        # Flights are re-run; their histories are not read from files.
        view |= {"total": total, "left": "", "histories": False}
        yield FlightTable(
            connection,
            {column["name"]: column["ends"] for column in view["columns"]},
            view,
            results,
        )


def _ranks(results: FlownCampaign) -> Any:
    """Return the rank, worst metric and missed requirements of each computed flight.

    Ranks are over all controllers, worst first.
    """
    import pyarrow as pa

    parts = []
    for name in results.controllers:
        flights = results.flights[name]
        columns: dict[str, Any] = {
            "controller": [name] * flights.flight.size,
            "flight": flights.flight,
            _RANK[1:-1]: results.ranking.ranks_of(name),
            _BY: results.ranking.criterion_index[name],
        }
        for k, item in enumerate(results.campaign.requirements):
            columns[f"missed {k}"] = requirement_failures(flights, item)
        parts.append(pa.table(columns))
    return pa.concat_tables(parts)


def parse_selection(data: Any, table: FlightTable) -> Selection:
    """Parse a selection sent by the browser.

    Raise InputError or ValueError if the selection is invalid.
    """
    selection = TypeAdapter(Selection).validate_python(data)
    for name in (
        selection.x,
        selection.y,
        *selection.brushes,
        *({selection.sort} - _SORTED.keys()),
    ):
        if name not in table.ranges:
            raise InputError(
                "request", f"unknown column {describe(name)}", one_of(list(table.ranges), name)
            )
    shares = [*_SHARES, *(f"missed {k}" for k in range(len(table.view["requirements"])))]
    if selection.outcome not in shares or not set(selection.controllers) <= set(table.order):
        raise InputError(
            "request",
            "unknown outcome or controller",
            f"the outcome {quoted(shares, 'or')}, and controllers among {quoted(table.order)}",
        )
    return selection


def count_flights(table: FlightTable, selection: Selection) -> dict[str, Any]:
    """Return the flights within all brushes as points or counts in cells, and histograms.

    At most MOST_POINTS flights are returned as points. ``ends`` are the ranges of both axes;
    ``cells`` contains [controller, column, row, flights]; ``points`` contains [controller, x, y,
    flight, whether it terminated early]; ``strips`` contains the histograms [bar, flights];
    ``rows`` contains [controller, flight, outcome, metrics...].
    """
    cursor = table.cursor()
    order = table.order
    where, values = _condition(table, selection)
    both = f"{where} and isfinite({_quoted(selection.x)}) and isfinite({_quoted(selection.y)})"
    (count,) = cursor.execute(f"select count(*) from shown where {where}", values).fetchone() or (
        0,
    )
    ends = [table.ranges[selection.x], table.ranges[selection.y]]
    if selection.fit:
        query = f"select {_ends(selection.x)}, {_ends(selection.y)} from shown where {both}"
        found_ends = cursor.execute(query, values).fetchone() or ()
        ends = [found_ends[:2], found_ends[2:]]
    counts: dict[str, Any] = {"count": count, "ends": ends, "cells": [], "points": []}
    kind = "points" if count <= MOST_POINTS else "cells"
    if kind == "points":
        rows = cursor.execute(
            f"select controller, {_quoted(selection.x)}, {_quoted(selection.y)}, flight, outcome "
            f"<> 'ok' from shown where {both}",
            values,
        ).fetchall()
    else:
        across, given_x = _bin(ends[0], selection.x, CELLS[0])
        up, given_y = _bin(ends[1], selection.y, CELLS[1])
        rows = cursor.execute(
            f"select controller, {across}, {up}, count(*) from shown where {both} group by all",
            [*given_x, *given_y, *values],
        ).fetchall()
    counts[kind] = [[order[name], *fields] for name, *fields in rows]
    counts["strips"] = {}
    for name in table.view["strips"]:
        bar, bin_parameters = _bin(table.ranges[name], name, BARS)
        finite = f"{where} and isfinite({_quoted(name)})"
        query = f"select {bar}, count(*) from shown where {finite} group by 1"
        counts["strips"][name] = cursor.execute(query, [*bin_parameters, *values]).fetchall()
    headed = "".join(f", {_finite(name)}" for name in table.view["headed"])
    listed = cursor.execute(
        f"select controller, flight, {_ended(table)}{headed} from shown "
        f"where {where} {_order(selection)} limit {LISTED}",
        values,
    ).fetchall()
    counts["rows"] = [[order[name], *fields] for name, *fields in listed]
    return counts


def find_nearest(
    table: FlightTable, selection: Selection, x: float, y: float
) -> tuple[int, int] | None:
    """Return the controller and number of the flight nearest to a point, or None.

    Distances are scaled by the ranges of the columns.
    """
    where, values = _condition(table, selection)
    terms = []
    for name, value in ((selection.x, x), (selection.y, y)):
        low, high = table.ranges[name]
        where += f" and isfinite({_quoted(name)})"
        terms.append(f"(({_quoted(name)} - ?) / ?)^2")
        values += [value, (high - low) or 1.0]
    query = (
        f"select controller, flight from shown where {where} order by {' + '.join(terms)}, "
        f"{_RANK} limit 1"
    )
    nearest = table.cursor().execute(query, values).fetchone()
    return None if nearest is None else (table.order[nearest[0]], int(nearest[1]))


def find_flight(table: FlightTable, controller: str, flight: int) -> dict[str, Any]:
    """Return all values of one flight. Raise InputError if it does not exist."""
    query = (
        f"select * replace ({_ended(table)} as outcome) from shown where controller::varchar = ? "
        "and flight = ?"
    )
    cursor = table.cursor().execute(query, [controller, flight])
    names = [column[0] for column in cursor.description or ()]
    row = cursor.fetchone()
    if row is None:
        raise InputError(
            "request",
            f"unknown flight {flight} of controller {describe(controller)}",
            "the number of a computed flight",
        )
    record = dict(zip(names, row, strict=True))
    return {
        "controller": table.order[controller],
        "flight": flight,
        "outcome": record["outcome"],
        "by": record[_BY],
        "missed": [record[f"missed {k}"] for k in range(len(table.view["requirements"]))],
        "values": {name: record[name] for name in table.ranges},
    }


def list_flights(table: FlightTable, selection: Selection) -> tuple[list[str], Iterator[list[Any]]]:
    """Return headings with units, and rows of the selected flights in the list's order."""
    where, values = _condition(table, selection)
    columns = table.view["columns"]
    named = ", ".join(_finite(column["name"]) for column in columns)
    query = (
        f"select controller::varchar, flight, outcome, {named} from shown where {where} "
        f"{_order(selection)}"
    )
    cursor = table.cursor().execute(query, values)
    heads = ["controller", "flight", "outcome", *(column["head"] for column in columns)]
    return heads, iter(lambda: cursor.fetchmany(_ROWS), [])


def _ended(table: FlightTable) -> str:
    """Return the SQL expression of the outcome text; see `topics.flights.model.ended_words`."""
    required = len(table.view["requirements"])
    missed = " + ".join(f'"missed {k}"::integer' for k in range(required)) or "0"
    return (
        f"case when outcome <> 'ok' then outcome when {missed} = 0 then 'completed' "
        f"else 'completed; misses ' || ({missed}) || ' of {required}' end"
    )


def _condition(table: FlightTable, selection: Selection) -> tuple[str, list[Any]]:
    """Return the SQL condition of a selection, with its parameters."""
    marks = ", ".join("?" * len(selection.controllers)) or "null"
    share = (
        _SHARES[selection.outcome]
        if selection.outcome in _SHARES
        else f"and {_quoted(selection.outcome)}"
    )
    text = f"controller in ({marks}) {share}"
    parameters: list[Any] = [*selection.controllers]
    for name, ends in selection.brushes.items():
        text += f" and {_quoted(name)} between ? and ?"
        parameters += sorted(ends)
    return text, parameters


def _order(selection: Selection) -> str:
    """Return the SQL order of flights; ties are sorted worst first."""
    key = _SORTED.get(selection.sort) or _finite(selection.sort)
    return f"order by {key} {'desc' if selection.down else 'asc'} nulls last, {_RANK}"


def _bin(ends: Sequence[float], name: str, bins: int) -> tuple[str, list[float]]:
    """Return the SQL expression of a column's bin, 0 to `bins` - 1, with parameters."""
    low, high = ends
    width = ((high - low) or 1.0) / bins
    return f"least(floor(({_quoted(name)} - ?) / ?), {bins - 1})::integer", [low, width]


def _finite(name: str) -> str:
    return f"case when isfinite({_quoted(name)}) then {_quoted(name)} end"


def _ends(name: str) -> str:
    """Return SQL for the smallest and largest finite value of a column; 0 if none is finite."""
    return f"coalesce(min({_finite(name)}), 0), coalesce(max({_finite(name)}), 0)"


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
