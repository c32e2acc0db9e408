"""Re-run of one flight of a campaign at full rate, compared with the stored flight."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from abhv_mc.execution.executor import open_flown, simulate
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.flights.repeatability import ROUNDING, Repeatability, relative_difference
from abhv_mc.flights.signals import Signal
from abhv_mc.folder.flights import (
    DamagedFileError,
    FlightRows,
    SampleReader,
    parse_block_name,
    read_pieces,
)
from abhv_mc.folder.hashes import read_checked
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import read_manifest
from abhv_mc.interfaces import Fly
from abhv_mc.io.messages import InputError

EQUAL_BITS = "equal the stored metrics bit for bit"  # text for identical metrics


@dataclass(frozen=True)
class Replay:
    """Result of a re-run flight."""

    controller: str
    flight: int
    block: FlightBlock  # results of the re-run flight
    samples: dict[str, float]
    metrics: dict[str, float]
    differences: tuple[str, ...]  # differences between the results and the stored row
    sentence: str  # sentence that states how the flight ended
    outcome: str  # code of the flight's outcome
    channels: tuple[Signal, ...] = ()  # channels of the history, if the block contains one
    repeatability: Repeatability | None = None  # repeatability of a custom simulator


def replay_flight(
    root: Path,
    controller: str,
    flight: int,
    fly: Fly | None = None,
    *,
    trust_code: bool = False,
) -> Replay:
    """Re-run a flight with its stored plan, recording every tick.

    `root` is the campaign's folder. `fly` is a function that replaces the campaign's simulator.
    """
    folder = CampaignFolder(root)
    experiment = open_flown(folder, [controller], trust_code)
    (row,) = find_rows(folder, controller, [flight])
    block = simulate(experiment, controller, row.samples, 1, fly)
    values = np.append(block.metrics[0], block.end_time[0])
    # Omit the stability margins, whose columns follow the metrics and the end time.
    stored = row.values[0][: values.size]
    repeatability = read_manifest(folder.manifest).repeatable
    if repeatability is Repeatability.ROUNDING:
        is_other = relative_difference(values, stored) > ROUNDING
    else:  # The comparison is bitwise: 0.0 differs from -0.0.
        is_other = values.view(np.int64) != stored.view(np.int64)
        is_other &= ~(np.isnan(values) & np.isnan(stored))
    differences = [
        f"{row.columns[i]}: {float(values[i])!r} instead of {float(stored[i])!r}"
        for i in np.flatnonzero(is_other)
    ]
    outcome, ends = int(block.outcome[0]), experiment.outcomes
    if ends.codes[outcome] != row.outcome[0]:
        reason = f" ({block.reasons[0]})" if 0 in block.reasons else ""
        differences.append(f"outcome: {ends.codes[outcome]}{reason} instead of {row.outcome[0]}")
    return Replay(
        controller=controller,
        flight=flight,
        block=block,
        samples=dict(zip(experiment.inputs, row.samples[0].tolist(), strict=True)),
        metrics=dict(zip(row.columns, values.tolist(), strict=False)),
        differences=tuple(differences),
        sentence=experiment.simulator.describe_end(controller, row.samples, outcome),
        outcome=ends.codes[outcome],
        channels=experiment.channels,
        repeatability=repeatability,
    )


def find_rows(folder: CampaignFolder, controller: str, flights: Sequence[int]) -> list[FlightRows]:
    """Return the stored rows of flights in the given order.

    Raise InputError if a flight is missing.
    """
    read_checked(folder, [folder.samples])
    names = SampleReader(folder.samples).names
    stored = {}
    for path in folder.flights.glob("*.parquet"):
        try:
            name, first, stop = parse_block_name(path)
            expected = [
                flight for flight in flights if name == controller and first <= flight < stop
            ]
            if expected:
                read_checked(folder, [path])
                for rows, _ in read_pieces(path, names):
                    for flight in expected:
                        if rows.first <= flight < rows.stop:
                            row_slice = slice(flight - rows.first, flight - rows.first + 1)
                            parts = {
                                field: getattr(rows, field)[row_slice]
                                for field in ("samples", "outcome", "values", "reasons")
                            }
                            stored[flight] = replace(rows, first=flight, **parts)
        except DamagedFileError as error:
            raise InputError(path, str(error), "a complete file; run the campaign again") from None
    for flight in flights:
        if flight not in stored:
            raise InputError(
                folder.root,
                f"the campaign has no flight {flight} of '{controller}'",
                "the number of a simulated flight",
            )
    return [stored[flight] for flight in flights]
