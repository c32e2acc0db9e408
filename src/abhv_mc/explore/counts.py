"""What the browser's view asks of the flights: counts in bins, the worst of them, and the flight at a place.

SQL is made of the table's own column names and of parameters; nothing that the browser sends becomes SQL.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from abhv_mc.folder.flown_campaign import FlownCampaign, read_flown
from abhv_mc.folder.sql import open_database
from abhv_mc.io.input_error import InputError, describe, one_of
from abhv_mc.topics.failed_flights import requirement_failures, requirement_words
from abhv_mc.topics.labels import full_labels
from abhv_mc.topics.parameter_words import axis_unit, spoken_name

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

CELLS = (120, 80)  # of the density, across and up
BARS = 60  # of a strip
MOST_POINTS = 4000  # drawn one by one; more are counted in cells
LISTED = 50  # rows of the table
_STRIPS = 12
_HEADED = 4  # metrics in the table
_SHARES = {"all": "", "failed": "and outcome <> 'ok'", "ok": "and outcome = 'ok'"}  # beside requirements missed


@dataclass(frozen=True)
class Asked:
    """What is shown: two columns against each other, of the flights within all brushes."""

    x: str
    y: str
    controllers: tuple[str, ...]
    outcome: str
    brushes: dict[str, tuple[float, float]]  # column -> ends, both included


@dataclass(frozen=True)
class FlightTable:
    """The flights in memory, and what the view is told of them once."""

    connection: "DuckDBPyConnection"
    ranges: Mapping[str, tuple[float, float]]  # column -> its smallest and largest finite value
    view: dict[str, Any]

    def cursor(self) -> "DuckDBPyConnection":
        """Another connection to the same tables: each request has a thread."""
        return self.connection.cursor()


@contextmanager
def open_flights(root: Path) -> Iterator[FlightTable]:
    """The flights of a campaign's folder. Raises InputError where it is none."""
    results = read_flown(root)
    columns = [*results.metrics, *results.dispersed]
    with open_database(root) as connection:
        connection.register("ranks", _ranks(results))
        scales = {name: axis_unit(name, results.campaign.parameters)[1] for name in results.dispersed}
        listed = ", ".join(f"{_quoted(name)} * {scales.get(name, 1.0)!r} as {_quoted(name)}" for name in columns)
        connection.execute("create type controllers as enum (select distinct controller from ranks)")  # thrice as fast
        connection.execute(
            "create table shown as select controller::controllers as controller, flight, outcome::varchar as outcome, "
            f"ranks.* exclude (controller, flight), {listed} from flights join ranks using (controller, flight)"
        )
        connection.unregister("ranks")
        ranges = find_ranges(connection, columns)
        yield FlightTable(connection, ranges, _describe(results, ranges))


def find_ranges(connection: "DuckDBPyConnection", columns: Sequence[str]) -> dict[str, tuple[float, float]]:
    """The smallest and largest finite value of each column; twice 0 where it has none."""
    ends = ", ".join(f"coalesce(min({_finite(name)}), 0), coalesce(max({_finite(name)}), 0)" for name in columns)
    found = connection.execute(f"select {ends} from shown").fetchone() or ()
    return {name: (float(found[2 * i]), float(found[2 * i + 1])) for i, name in enumerate(columns)}


def _ranks(results: FlownCampaign) -> Any:
    """Of each flight that was computed, its place among those of all controllers, the worst first, and whether it
    misses each requirement."""
    import pyarrow as pa

    parts, required = [], results.campaign.requirements
    for name in results.controllers:
        flights = results.flights[name]
        columns: dict[str, Any] = {"flight": flights.flight, "rank": results.ranking.places_of(name)}
        columns |= {f"missed {k}": requirement_failures(flights, item) for k, item in enumerate(required)}
        parts.append(pa.table({"controller": [name] * flights.flight.size, **columns}))
    return pa.concat_tables(parts)


def _describe(results: FlownCampaign, ranges: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    records, names = results.campaign.metrics, results.controllers
    metrics = [{"name": name, "label": records[name].label_with_unit} for name in results.metrics]
    spoken = [(name, spoken_name(name), axis_unit(name, results.campaign.parameters)[0]) for name in results.dispersed]
    dispersions = [
        {"name": name, "label": f"{words[:1].upper()}{words[1:]}{f' ({unit})' if unit else ''}"}
        for name, words, unit in spoken
    ]
    labels = full_labels(results.folder, names)
    headed = (results.asked or results.metrics)[:_HEADED]
    return {
        "name": results.campaign.name,
        "folder": results.folder.as_posix(),
        "controllers": [{"name": name, "label": labels[name]} for name in names],
        "metrics": metrics,
        "dispersions": dispersions,
        "ranges": {name: list(ends) for name, ends in ranges.items()},
        "headed": [{"name": name, "label": records[name].label_with_unit} for name in headed],
        "missed": [requirement_words(item, records) for item in results.campaign.requirements],
        "strips": [entry["name"] for entry in dispersions[:_STRIPS]],
        "cells": list(CELLS),
        "x": (results.dispersed or results.metrics)[0],
        "y": headed[0],
    }


def parse_asked(data: Any, table: FlightTable) -> Asked:
    """What the browser sent. Raises InputError for what the view never sends."""
    try:
        names = [str(name) for name in data["controllers"]]
        known = [entry["name"] for entry in table.view["controllers"]]
        brushes = {str(name): (float(ends[0]), float(ends[1])) for name, ends in dict(data["brushes"]).items()}
        asked = Asked(str(data["x"]), str(data["y"]), tuple(names), str(data["outcome"]), brushes)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError("request", describe(str(error)), "x, y, controllers, outcome, brushes") from None
    for name in (asked.x, asked.y, *brushes):
        if name not in table.ranges:
            raise InputError("request", f"no column {describe(name)}", one_of(list(table.ranges), name))
    shares = [*_SHARES, *(f"missed {k}" for k in range(len(table.view["missed"])))]
    if asked.outcome not in shares or not set(names) <= set(known):
        raise InputError("request", "an unknown outcome or controller", f"{', '.join(shares)}; {known}")
    return asked


def count_flights(table: FlightTable, asked: Asked) -> dict[str, Any]:
    """How many flights are within all brushes; in which cells (or, where they are few, where each is); the strips.

    ``cells``: [controller, across, up, flights]; ``points``: [controller, x, y, flight, lost]; ``strips``: of each
    [bar, flights]; ``worst``: [controller, flight, outcome, metrics...].
    """
    cursor = table.cursor()
    where, values = _condition(table, asked)
    both = f"{where} and isfinite({_quoted(asked.x)}) and isfinite({_quoted(asked.y)})"
    (count,) = cursor.execute(f"select count(*) from shown where {where}", values).fetchone() or (0,)
    order = {entry["name"]: k for k, entry in enumerate(table.view["controllers"])}
    found: dict[str, Any] = {"count": count, "cells": [], "points": []}
    if count <= MOST_POINTS:
        rows = cursor.execute(
            f"select controller, {_quoted(asked.x)}, {_quoted(asked.y)}, flight, outcome <> 'ok' from shown "
            f"where {both}",
            values,
        ).fetchall()
        found["points"] = [[order[name], *rest] for name, *rest in rows]
    else:
        across, given_x = _bin(table, asked.x, CELLS[0])
        up, given_y = _bin(table, asked.y, CELLS[1])
        rows = cursor.execute(
            f"select controller, {across}, {up}, count(*) from shown where {both} group by all",
            [*given_x, *given_y, *values],
        ).fetchall()
        found["cells"] = [[order[name], *rest] for name, *rest in rows]
    found["strips"] = {}
    for name in table.view["strips"]:
        bar, given = _bin(table, name, BARS)
        finite = f"{where} and isfinite({_quoted(name)})"
        query = f"select {bar}, count(*) from shown where {finite} group by 1"
        found["strips"][name] = cursor.execute(query, [*given, *values]).fetchall()
    headed = ", ".join(_finite(entry["name"]) for entry in table.view["headed"])
    found["worst"] = cursor.execute(
        f"select controller, flight, outcome, {headed} from shown where {where} order by rank limit {LISTED}",
        values,
    ).fetchall()
    return found


def find_nearest(table: FlightTable, asked: Asked, x: float, y: float) -> tuple[str, int] | None:
    """Controller and number of the flight that lies nearest, in units of the columns' ranges; None without one."""
    where, values = _condition(table, asked)
    sizes = [(table.ranges[name][1] - table.ranges[name][0]) or 1.0 for name in (asked.x, asked.y)]
    one, other = _quoted(asked.x), _quoted(asked.y)
    found = (
        table.cursor()
        .execute(
            f"select controller, flight from shown where {where} and isfinite({one}) and isfinite({other}) "
            f"order by (({one} - ?) / ?)^2 + (({other} - ?) / ?)^2, rank limit 1",
            [*values, x, sizes[0], y, sizes[1]],
        )
        .fetchone()
    )
    return None if found is None else (found[0], int(found[1]))


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


def _bin(table: FlightTable, name: str, bins: int) -> tuple[str, list[float]]:
    """The SQL of a column's bin, 0 to ``bins`` - 1 over its range, and its parameters."""
    low, high = table.ranges[name]
    return f"least(floor(({_quoted(name)} - ?) / ?), {bins - 1})::integer", [low, ((high - low) or 1.0) / bins]


def _finite(name: str) -> str:
    return f"case when isfinite({_quoted(name)}) then {_quoted(name)} end"


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
