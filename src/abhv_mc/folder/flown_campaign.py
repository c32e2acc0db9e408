"""Results of a campaign as arrays, the source of all tables, figures and pages."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Ints
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.requirement_set import (
    RequirementChange,
    RequirementSource,
    is_campaign,
    judge_by,
)
from abhv_mc.flights.metrics import MARGIN_FAULTS, MARGIN_NAMES
from abhv_mc.folder.controller_flights import ControllerFlights, Ranking, rank_flights, read_flights
from abhv_mc.folder.file_columns import FileColumns, read_table
from abhv_mc.folder.flights import END_TIME, POINT
from abhv_mc.folder.hashes import data_files, read_checked, refuse_changes
from abhv_mc.folder.histories import MOST_MEDIAN, QUANTILE_COLUMNS
from abhv_mc.folder.inputs import read_folder_campaign
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import Manifest, read_manifest
from abhv_mc.folder.requirement_sets import count_known_flights, mark_later_choices
from abhv_mc.folder.steady_margins import SteadyMargins, read_steady_margins
from abhv_mc.io.messages import InputError
from abhv_mc.io.parquet_columns import column_values, distinct_texts
from abhv_mc.statistics.circular import move_near

_HISTORIES = "histories of flights"
BANDS = ("min", *QUANTILE_COLUMNS, "max")


@dataclass(frozen=True)
class Envelope:
    """Time-history envelope of one channel of one controller over all flights."""

    time: Floats  # [time], s
    count: Ints  # [time] number of flights that have not ended
    bands: dict[str, Floats]  # [time] values by name of the band

    @property
    def median(self) -> Floats:
        """Median [time]; with unknown parameters, the mean of its lower and upper edges."""
        return np.asarray(
            (self.bands["q50"] + self.bands.get(MOST_MEDIAN, self.bands["q50"])) / 2.0
        )


@dataclass(frozen=True)
class FlownCampaign:
    """Campaign, samples, flights and envelopes read from a results folder."""

    folder: Path
    campaign: Experiment
    manifest: Manifest
    samples: Mapping[str, Floats]  # [flight] values by parameter; each access reads the column
    flights: dict[str, ControllerFlights]
    envelopes: dict[tuple[str, str], Envelope]  # envelopes by (controller, channel)
    reference: dict[str, Floats]  # [time] values of "time" and the reference channels
    nominal: dict[str, dict[str, Floats]]  # [time] values of "time" and the channels, by controller
    steady_margins: SteadyMargins = field(default_factory=SteadyMargins)
    # changes of requirements that were made after results had been seen, in order
    requirement_changes: tuple[RequirementChange, ...] = ()
    changed_after: int = 0  # number of flights with known results at the first of these changes
    judged_by: str = ""  # file, or FILE for entries in memory, that replaces the requirements
    judged_by_campaign: bool = False  # whether this file is a campaign file

    def align(self, controller: str, curves: Mapping[str, Floats]) -> dict[str, Floats]:
        """Return channels or references over "time"; angles are near the controller's envelopes."""
        aligned = dict(curves)
        for name, curve in curves.items():
            channel = name.replace("_reference", "")
            envelope = self.envelopes.get((controller, channel))
            period = self.campaign.periods.get(channel)
            if envelope and period and (finite := np.isfinite(envelope.median)).any():
                median = envelope.time[finite], envelope.median[finite]
                aligned[name] = move_near(curve, np.interp(curves["time"], *median), period)
        return aligned

    def refuse_changes(self) -> None:
        """Raise InputError if a run has changed the folder since it was read.

        Call this function after the results have been used.
        """
        if self.manifest.files:  # The list is empty if the manifest was not read from a folder.
            refuse_changes(CampaignFolder(self.folder), self.manifest)

    @property
    def controllers(self) -> tuple[str, ...]:
        """Simulated controllers in the order of the campaign."""
        return tuple(name for name in self.campaign.controllers if name in self.flights)

    @cached_property
    def ranking(self) -> Ranking:
        """Ranking of the flights of all controllers, worst first."""
        return rank_flights(
            {name: self.flights[name] for name in self.controllers}, self.campaign.criteria
        )

    @property
    def dispersed(self) -> tuple[str, ...]:
        """Dispersed parameters: all sampled parameters except noise seeds."""
        return tuple(name for name in self.samples if not self.campaign.parameters[name].seed)

    @property
    def metrics(self) -> tuple[str, ...]:
        """Stored metrics: required metrics first, then others in order of definition."""
        stored = [
            name for name in next(iter(self.flights.values())).metrics if name not in self._excluded
        ]
        ordered = [name for name in (*self.asked, *self.campaign.metrics) if name in stored]
        return tuple(dict.fromkeys(ordered))

    @property
    def asked(self) -> tuple[str, ...]:
        """Metrics on which the campaign has requirements."""
        stored = next(iter(self.flights.values())).metrics
        return tuple(
            name for name in self.campaign.asked if name in stored and name not in self._excluded
        )

    @property
    def compared(self) -> tuple[str, ...]:
        """Metrics by which controllers are compared: required metrics and control effort."""
        usage = [name for name in self.metrics if self.campaign.metrics[name].group == "usage"]
        return tuple(dict.fromkeys((*self.asked, *usage)))

    @property
    def _excluded(self) -> tuple[str, ...]:
        """Stored columns that are not metrics, and margins if some flights lack them.

        Margins computed for only some flights are shown only in the section on stability.
        """
        faults = (END_TIME.name, *(signal.name for signal in MARGIN_FAULTS))
        has_all = self.campaign.margin_flights >= self.campaign.runs
        return faults if has_all else (*faults, *MARGIN_NAMES)

    @property
    def pairs(self) -> Sequence[tuple[str, str]]:
        """All pairs of controllers, sorted by name."""
        return list(combinations(sorted(self.controllers), 2))


def _columns(table: pa.Table) -> dict[str, Any]:
    return {name: _values(table[name]) for name in table.column_names}


def _values(column: pa.ChunkedArray) -> NDArray[Any]:
    if not pa.types.is_string(column.type):
        return column_values(column)
    texts, which = distinct_texts(column)
    return np.array(texts)[which]


def _read_envelopes(path: Path) -> dict[tuple[str, str], Envelope]:
    names = ["controller", "channel"]
    table = read_table(path, "the envelopes of a campaign", texts=names)
    controllers, controller = distinct_texts(table["controller"])
    channels, channel = distinct_texts(table["channel"])
    columns = _columns(table.drop_columns(names))
    stored = [name for name in (*BANDS, MOST_MEDIAN) if name != MOST_MEDIAN or name in columns]
    cells: dict[tuple[str, str], Envelope] = {}
    for i, j in dict.fromkeys(zip(controller.tolist(), channel.tolist(), strict=True)):
        rows = np.flatnonzero((controller == i) & (channel == j))
        rows = rows[np.argsort(columns["time"][rows], kind="stable")]
        bands = {name: columns[name][rows].astype(np.float64) for name in stored}
        cells[controllers[i], channels[j]] = Envelope(
            columns["time"][rows].astype(np.float64), columns["count"][rows].astype(np.int64), bands
        )
    return cells


def _read_nominal(path: Path) -> dict[str, dict[str, Floats]]:
    columns = _columns(read_table(path, "the nominal flight of each controller"))
    names = columns.pop("controller").astype(str)
    return {
        name: {key: value[names == name].astype(np.float64) for key, value in columns.items()}
        for name in dict.fromkeys(names.tolist())
    }


def read_flown(root: Path, requirements: RequirementSource | None = None) -> FlownCampaign:
    """Read a results folder; ``requirements`` may replace the folder's requirements.

    Raise InputError if a file is missing or invalid, or if the requirements are invalid.
    """
    folder = CampaignFolder(root)
    manifest = read_checked(folder)
    if manifest.shard:
        raise InputError(
            root,
            "the folder is shard {}/{} of a campaign".format(*manifest.shard),
            "a complete campaign (merge its shards with 'abhv-mc merge')",
        )
    samples = FileColumns(folder.samples, "the samples of a campaign", without=("flight", POINT))
    campaign = replace(read_folder_campaign(folder), repeatability=manifest.repeatable)
    is_file = isinstance(requirements, str | Path)
    if requirements is not None:
        campaign = judge_by(campaign, requirements)
    campaign, changes = mark_later_choices(folder, manifest, campaign, requirements is None)
    flights = read_flights(
        folder.flights, data_files(folder, manifest), campaign.metrics, ends=campaign.outcomes
    )
    has_mission = campaign.simulator.mission is not None
    reference = (
        _columns(read_table(folder.reference, "the mission's reference")) if has_mission else {}
    )
    results = FlownCampaign(
        folder=root,
        campaign=campaign,
        manifest=manifest,
        samples=samples,
        flights=flights,
        envelopes=_read_envelopes(folder.envelopes) if campaign.has_bands else {},
        reference={name: value.astype(np.float64) for name, value in reference.items()},
        nominal=_read_nominal(folder.nominal) if has_mission else {},
        steady_margins=read_steady_margins(folder.margins) if has_mission else SteadyMargins(),
        requirement_changes=changes,
        changed_after=min(
            (stored.flights for stored in manifest.requirement_sets if stored.flights),
            default=count_known_flights(manifest),
        )
        if changes
        else 0,
        judged_by="" if requirements is None else str(requirements) if is_file else "FILE",
        judged_by_campaign=requirements is not None and is_campaign(requirements),
    )
    first = next(iter(results.controllers), "")
    return replace(results, reference=results.align(first, results.reference))


def read_histories(root: Path, controller: str) -> dict[int, dict[str, Floats]]:
    """Return the stored histories of a controller, by flight and channel (or "time") [time]."""
    histories: dict[int, dict[str, Floats]] = {}
    for path in _history_files(root, controller):
        histories |= _read_file(path)
    return histories


def read_replayed(path: Path) -> tuple[str, int, dict[str, Floats]]:
    """Return controller, flight and history of a re-run flight, as in `read_histories`."""
    ((flight, columns),) = _read_file(path).items()
    return path.stem.rpartition("-")[0], flight, columns


def _read_file(path: Path) -> dict[int, dict[str, Floats]]:
    columns = _columns(read_table(path, _HISTORIES).drop_columns(["controller"]))
    numbers, histories = columns.pop("flight"), {}
    for number in np.unique(numbers):
        rows = np.flatnonzero(numbers == number)
        histories[int(number)] = {
            key: value[rows].astype(np.float64) for key, value in columns.items()
        }
    return histories


def flights_with_history(root: Path, controller: str) -> set[int]:
    """Return the numbers of a controller's flights that have stored histories."""
    tables = (read_table(path, _HISTORIES, ["flight"]) for path in _history_files(root, controller))
    return {
        number for table in tables for number in np.unique(column_values(table["flight"])).tolist()
    }


def _history_files(root: Path, controller: str) -> Iterator[Path]:
    """Yield the history files of one controller."""
    folder = CampaignFolder(root)
    for path in data_files(folder, read_manifest(folder.manifest)):
        if path.parent == folder.histories:
            names = read_table(path, _HISTORIES, ["controller"])["controller"]
            if names[:1].to_pylist() == [controller]:  # All rows have the same controller.
                yield path
