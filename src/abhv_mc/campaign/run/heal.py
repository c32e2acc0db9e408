"""Flights that could not be computed, flown again: what can be computed now takes its place in its block."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from abhv_mc.campaign.run.batches import Fly
from abhv_mc.campaign.run.progress import Progress
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightBlock, FlightPlan
from abhv_mc.store.flights import parse_block_name, read_block, write_block

_PIECE = 16  # flights flown at once: one that hangs again costs its piece twice the time limit

Floats = NDArray[np.float64]
Row = tuple[str, Floats]  # outcome's code and values in the order of VALUES


def fly_again(
    fly: Fly,
    plans: Mapping[str, FlightPlan],
    again: Mapping[str, list[int]],
    parameters: Callable[[int, int], Floats],
    workers: int,
) -> dict[str, dict[int, Row]]:
    """Rows by controller and flight of those flights that can be computed now; ``parameters(first, stop)`` of them."""
    from joblib import Parallel, delayed

    pieces = [
        (name, flights[i : i + _PIECE]) for name, flights in again.items() for i in range(0, len(flights), _PIECE)
    ]
    rows: dict[str, dict[int, Row]] = {}

    def fly_piece(name: str, flights: list[int]) -> tuple[str, list[int], FlightBlock]:
        values = np.concatenate([parameters(flight, flight + 1) for flight in flights])
        return name, flights, fly(plans[name], values, None)

    pool = Parallel(n_jobs=workers, backend="threading", return_as="generator_unordered")
    with Progress("flights tried again", sum(len(flights) for _, flights in pieces)) as progress:
        for name, flights, block in pool(delayed(fly_piece)(*piece) for piece in pieces):
            values = np.column_stack([block.metrics, block.end_time])
            for i, flight in enumerate(flights):
                if block.outcome[i] != Outcome.FAILED_TO_RUN:
                    rows.setdefault(name, {})[flight] = Outcome(int(block.outcome[i])).code, values[i]
            progress.add(len(flights))
    return rows


def heal_blocks(
    folder: Path, controller: str, names: tuple[str, ...], found: Mapping[int, Row], schema: pa.Schema
) -> None:
    """Put the rows in the places of those that stand for flights that could not be computed."""
    for path in sorted(folder.glob("*.parquet")):
        name, first, stop = parse_block_name(path)
        here = [flight for flight in found if first <= flight < stop]
        if name != controller or not here:
            continue
        rows = read_block(path, names)
        outcome, values = list(rows.outcome), rows.values.copy()
        for flight in here:
            outcome[flight - first], values[flight - first] = found[flight]
        write_block(folder, replace(rows, outcome=tuple(outcome), values=values), schema)
