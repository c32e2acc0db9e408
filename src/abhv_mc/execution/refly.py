"""Flights that could not be computed, flown again: what can be computed now takes its place in its block."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from abhv_mc.execution.blocks import Fly
from abhv_mc.execution.progress import Progress
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightBlock, FlightPlan
from abhv_mc.folder.digest import Digest
from abhv_mc.folder.flights import parse_block_name, read_block, write_block

_PIECE = 16  # flights flown at once: one that hangs again costs its piece twice the time limit

Floats = NDArray[np.float64]
Row = tuple[str, Floats]  # outcome's code and values in the order of VALUES


def fly_again(
    fly: Fly,
    plan_of: Callable[[str, int], FlightPlan],
    again: Mapping[str, list[int]],
    parameters: Callable[[int, int], Floats],
    make_values: Callable[[FlightBlock], Floats],
    workers: int,
) -> dict[str, dict[int, Row]]:
    """Rows by controller and flight of those flights that can be computed now.

    ``plan_of(controller, flight)`` is what a flight flies, ``parameters(first, stop)`` what is dispersed of it, and
    ``make_values`` gives the row's values ``[flight, value]``.
    """
    from joblib import Parallel, delayed

    alike: dict[tuple[str, int], tuple[FlightPlan, list[int]]] = {}  # flights of one plan
    for name, flights in again.items():
        for flight in flights:
            plan = plan_of(name, flight)
            alike.setdefault((name, id(plan)), (plan, []))[1].append(flight)
    pieces = [
        (name, plan, flights[i : i + _PIECE])
        for (name, _), (plan, flights) in alike.items()
        for i in range(0, len(flights), _PIECE)
    ]
    rows: dict[str, dict[int, Row]] = {}

    def fly_piece(name: str, plan: FlightPlan, flights: list[int]) -> tuple[str, list[int], FlightBlock]:
        values = np.concatenate([parameters(flight, flight + 1) for flight in flights])
        return name, flights, fly(plan, values, None)

    pool = Parallel(n_jobs=workers, backend="threading", return_as="generator_unordered")
    with Progress("flights tried again", sum(map(len, again.values()))) as progress:
        for name, flights, block in pool(delayed(fly_piece)(*piece) for piece in pieces):
            values = make_values(block)
            for i, flight in enumerate(flights):
                if block.outcome[i] != Outcome.FAILED_TO_RUN:
                    rows.setdefault(name, {})[flight] = Outcome(int(block.outcome[i])).code, values[i]
            progress.add(len(flights))
    return rows


def refly_blocks(
    folder: Path, controller: str, names: tuple[str, ...], found: Mapping[int, Row], schema: pa.Schema
) -> Digest:
    """Put the rows in the places of those that stand for flights that could not be computed; the digest of these."""
    healed = Digest()
    for path in sorted(folder.glob("*.parquet")):
        name, first, stop = parse_block_name(path)
        here = [flight for flight in found if first <= flight < stop]
        if name != controller or not here:
            continue
        rows = read_block(path, names)
        outcome, values, before = list(rows.outcome), rows.values.copy(), rows.digest()
        for flight in here:
            outcome[flight - first], values[flight - first] = found[flight]
        healed += write_block(folder, replace(rows, outcome=tuple(outcome), values=values), schema) - before
    return healed
