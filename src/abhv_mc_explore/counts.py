"""What the browser's view asks of the flights: counts in bins, a list of them, one of them, and all as CSV.

SQL is made of the table's own column names and of parameters; nothing that the browser sends becomes SQL.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter

from abhv_mc.folder.flown_campaign import FlownCampaign, read_flown
from abhv_mc.folder.tables import open_database
from abhv_mc.io.input_error import InputError, describe, one_of
from abhv_mc.report.pages.flights_view import BARS, CELLS, LISTED, describe_flights
from abhv_mc.topics.figure_style import controller_colors
from abhv_mc.topics.missed_requirements import requirement_failures
from abhv_mc.topics.names import full_labels
from abhv_mc.topics.words import axis_unit

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

MOST_POINTS = 4000  # drawn one by one; more are counted in cells
_ROWS = 10_000  # fetched at once
_SHARES = {
    "all": "",
    "failed": "and outcome <> 'ok'",
    "ok": "and outcome = 'ok'",
}  # beside requirements missed
_OWN = (
    "rank",
    "flight",
    "controller",
    "outcome",
)  # columns of the list that are no numbers of flights
_RANK, _BY = '"its rank"', "worst in"  # no metric has a name with a space


@dataclass(frozen=True)
class Asked:
    """What is shown: two columns against each other, of the flights within all brushes."""

    x: str
    y: str
    controllers: tuple[str, ...]
    outcome: str
    brushes: dict[str, tuple[float, float]]  # column -> ends, both included
    fit: bool = False  # whether the axes reach as far as these flights only
    sort: str = "rank"  # by what they are listed
    down: bool = False  # whether the largest comes first


@dataclass(frozen=True)
class FlightTable:
    """The flights in memory, and what the view is told of them once."""

    connection: "DuckDBPyConnection"
    ranges: Mapping[str, tuple[float, float]]  # column -> the ends of its axis
    view: dict[str, Any]
    results: FlownCampaign = field(repr=False)

    def cursor(self) -> "DuckDBPyConnection":
        """Another connection to the same tables: each request has a thread."""
        return self.connection.cursor()

    @property
    def order(self) -> dict[str, int]:
        """The place of each controller in the campaign."""
        return {entry["name"]: k for k, entry in enumerate(self.view["controllers"])}


@contextmanager
def open_flights(root: Path) -> Iterator[FlightTable]:
    """The flights of a campaign's folder. Raises InputError where it is none."""
    results = read_flown(root)
    names, columns = results.controllers, [*results.metrics, *results.dispersed]
    with open_database(root) as connection:
        connection.register("ranks", _ranks(results))
        scales = {
            name: axis_unit(name, results.campaign.parameters)[1] for name in results.dispersed
        }
        listed = ", ".join(
            f"{_quoted(name)} * {scales.get(name, 1.0)!r} as {_quoted(name)}" for name in columns
        )
        known = ", ".join("'" + name.replace("'", "''") + "'" for name in names)
        connection.execute(
            f"create type controllers as enum ({known})"
        )  # thrice as fast, in the campaign's order
        connection.execute(
            "create table shown as select controller::controllers as controller, flight, "
            "replace(outcome::varchar, '_', ' ') as outcome, "
            f"ranks.* exclude (controller, flight), {listed} from flights join ranks using (controller, flight)"
        )
        connection.unregister("ranks")
        found = (
            connection.execute(f"select {', '.join(map(_ends, columns))} from shown").fetchone()
            or ()
        )
        ends = {
            name: (float(found[2 * i]), float(found[2 * i + 1])) for i, name in enumerate(columns)
        }
        labels, colors = full_labels(results.folder, names), controller_colors(names)
        channels = [channel.name for channel in results.campaign.channels]
        view = describe_flights(results, labels, colors, ends, channels)
        (total,) = connection.execute("select count(*) from shown").fetchone() or (0,)
        view |= {
            "total": total,
            "left": "",
            "histories": False,
        }  # every flight has one: it is flown again
        yield FlightTable(
            connection, {each["name"]: each["ends"] for each in view["columns"]}, view, results
        )


def _ranks(results: FlownCampaign) -> Any:
    """Of each flight that was computed, its place among those of all controllers, the worst first, in what it is worst,
    and whether it misses each requirement."""
    import pyarrow as pa

    parts, required = [], results.campaign.requirements
    for name in results.controllers:
        flights, ranking = results.flights[name], results.ranking
        columns: dict[str, Any] = {"flight": flights.flight, _RANK[1:-1]: ranking.places_of(name)}
        columns[_BY] = ranking.by[name]
        columns |= {
            f"missed {k}": requirement_failures(flights, item) for k, item in enumerate(required)
        }
        parts.append(pa.table({"controller": [name] * flights.flight.size, **columns}))
    return pa.concat_tables(parts)


def parse_asked(data: Any, table: FlightTable) -> Asked:
    """What the browser sent. Raises InputError or ValueError for what the view never sends."""
    asked = TypeAdapter(Asked).validate_python(data)
    for name in (asked.x, asked.y, *asked.brushes, *({asked.sort} - set(_OWN))):
        if name not in table.ranges:
            raise InputError(
                "request", f"no column {describe(name)}", one_of(list(table.ranges), name)
            )
    shares = [*_SHARES, *(f"missed {k}" for k in range(len(table.view["requirements"])))]
    if asked.outcome not in shares or not set(asked.controllers) <= set(table.order):
        raise InputError(
            "request",
            "an unknown outcome or controller",
            f"{', '.join(shares)}; {list(table.order)}",
        )
    return asked


def count_flights(table: FlightTable, asked: Asked) -> dict[str, Any]:
    """How many flights are within all brushes; in which cells (or, where they are few, where each is); the strips.

    ``ends``: of both axes; ``cells``: [controller, across, up, flights]; ``points``: [controller, x, y, flight, lost];
    ``strips``: of each [bar, flights]; ``rows``: [controller, flight, outcome, metrics...].
    """
    cursor, order = table.cursor(), table.order
    where, values = _condition(table, asked)
    both = f"{where} and isfinite({_quoted(asked.x)}) and isfinite({_quoted(asked.y)})"
    (count,) = cursor.execute(f"select count(*) from shown where {where}", values).fetchone() or (
        0,
    )
    ends = [table.ranges[asked.x], table.ranges[asked.y]]
    if asked.fit:
        query = f"select {_ends(asked.x)}, {_ends(asked.y)} from shown where {both}"
        found_ends = cursor.execute(query, values).fetchone() or ()
        ends = [found_ends[:2], found_ends[2:]]
    found: dict[str, Any] = {"count": count, "ends": ends, "cells": [], "points": []}
    if count <= MOST_POINTS:
        rows = cursor.execute(
            f"select controller, {_quoted(asked.x)}, {_quoted(asked.y)}, flight, outcome <> 'ok' from shown "
            f"where {both}",
            values,
        ).fetchall()
        found["points"] = [[order[name], *rest] for name, *rest in rows]
    else:
        across, given_x = _bin(ends[0], asked.x, CELLS[0])
        up, given_y = _bin(ends[1], asked.y, CELLS[1])
        rows = cursor.execute(
            f"select controller, {across}, {up}, count(*) from shown where {both} group by all",
            [*given_x, *given_y, *values],
        ).fetchall()
        found["cells"] = [[order[name], *rest] for name, *rest in rows]
    found["strips"] = {}
    for name in table.view["strips"]:
        bar, given = _bin(table.ranges[name], name, BARS)
        finite = f"{where} and isfinite({_quoted(name)})"
        query = f"select {bar}, count(*) from shown where {finite} group by 1"
        found["strips"][name] = cursor.execute(query, [*given, *values]).fetchall()
    headed = "".join(f", {_finite(name)}" for name in table.view["headed"])
    listed = cursor.execute(
        f"select controller, flight, {_ended(table)}{headed} from shown where {where} {_order(asked)} limit {LISTED}",
        values,
    ).fetchall()
    found["rows"] = [[order[name], *rest] for name, *rest in listed]
    return found


def find_nearest(table: FlightTable, asked: Asked, x: float, y: float) -> tuple[int, int] | None:
    """Controller and number of the flight that lies nearest, in units of the columns' ranges; None without one."""
    where, values = _condition(table, asked)
    sizes = [(table.ranges[name][1] - table.ranges[name][0]) or 1.0 for name in (asked.x, asked.y)]
    one, other = _quoted(asked.x), _quoted(asked.y)
    found = (
        table.cursor()
        .execute(
            f"select controller, flight from shown where {where} and isfinite({one}) and isfinite({other}) "
            f"order by (({one} - ?) / ?)^2 + (({other} - ?) / ?)^2, {_RANK} limit 1",
            [*values, x, sizes[0], y, sizes[1]],
        )
        .fetchone()
    )
    return None if found is None else (table.order[found[0]], int(found[1]))


def find_flight(table: FlightTable, controller: str, flight: int) -> dict[str, Any]:
    """Everything that the table says of one flight. Raises InputError where there is none."""
    query = f"select * replace ({_ended(table)} as outcome) from shown where controller::varchar = ? and flight = ?"
    cursor = table.cursor().execute(query, [controller, flight])
    names = [column[0] for column in cursor.description or ()]
    row = cursor.fetchone()
    if row is None:
        raise InputError(
            "request", f"no flight {flight} of {describe(controller)}", "one that was computed"
        )
    held = dict(zip(names, row, strict=True))
    missed = [held[f"missed {k}"] for k in range(len(table.view["requirements"]))]
    values = {name: held[name] for name in table.ranges}
    found = {
        "controller": table.order[controller],
        "flight": flight,
        "outcome": held["outcome"],
        "by": held[_BY],
    }
    return {**found, "missed": missed, "values": values}


def list_flights(table: FlightTable, asked: Asked) -> tuple[list[str], Iterator[list[Any]]]:
    """Heads with units, and rows of every column of the flights within all brushes, in the order of the list."""
    where, values = _condition(table, asked)
    columns = table.view["columns"]
    named = ", ".join(_finite(each["name"]) for each in columns)
    query = f"select controller::varchar, flight, outcome, {named} from shown where {where} {_order(asked)}"
    cursor = table.cursor().execute(query, values)
    heads = ["controller", "flight", "outcome", *(each["head"] for each in columns)]
    return heads, iter(lambda: cursor.fetchmany(_ROWS), [])


def _ended(table: FlightTable) -> str:
    """Return the SQL of how a flight ended, in the words of `abhv_mc.topics.flights.model.ended_words`."""
    required = len(table.view["requirements"])
    missed = " + ".join(f'"missed {k}"::integer' for k in range(required)) or "0"
    return (
        f"case when outcome <> 'ok' then outcome when {missed} = 0 then 'completed' "
        f"else 'completed; misses ' || ({missed}) || ' of {required}' end"
    )


def _condition(table: FlightTable, asked: Asked) -> tuple[str, list[Any]]:
    """The SQL of what is asked, and its parameters."""
    marks = ", ".join("?" * len(asked.controllers)) or "null"
    share = _SHARES[asked.outcome] if asked.outcome in _SHARES else f"and {_quoted(asked.outcome)}"
    text = f"controller in ({marks}) {share}"
    parameters: list[Any] = [*asked.controllers]
    for name, ends in asked.brushes.items():
        text += f" and {_quoted(name)} between ? and ?"
        parameters += sorted(ends)
    return text, parameters


def _order(asked: Asked) -> str:
    """The SQL of the order in which flights are listed; equal ones the worst first."""
    by = (
        _RANK if asked.sort == "rank" else asked.sort if asked.sort in _OWN else _finite(asked.sort)
    )
    return f"order by {by} {'desc' if asked.down else 'asc'} nulls last, {_RANK}"


def _bin(ends: Sequence[float], name: str, bins: int) -> tuple[str, list[float]]:
    """The SQL of a column's bin, 0 to ``bins`` - 1 between two ends, and its parameters."""
    low, high = ends
    return f"least(floor(({_quoted(name)} - ?) / ?), {bins - 1})::integer", [
        low,
        ((high - low) or 1.0) / bins,
    ]


def _finite(name: str) -> str:
    return f"case when isfinite({_quoted(name)}) then {_quoted(name)} end"


def _ends(name: str) -> str:
    """The SQL of a column's smallest and largest finite value; twice 0 where it has none."""
    return f"coalesce(min({_finite(name)}), 0), coalesce(max({_finite(name)}), 0)"


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
