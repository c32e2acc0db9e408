"""A campaign's folder as plain arrays: what every table, figure and page of a report is made from."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from abhv_mc.documents import InputError
from abhv_mc.flight.signals import METRICS

Floats = NDArray[np.float64]
QUANTILE_COLUMNS = ("min", "q0.135", "q5", "q50", "q95", "q99.865", "max")
INDEPENDENT_DESIGNS = ("random",)


@dataclass(frozen=True)
class Requirement:
    """A metric that must stay below (or above) a limit in a share of the flights."""

    metric: str
    limit: float
    below: bool
    probability: float
    consumer_risk: float
    controllers: tuple[str, ...]
    early_is_failure: bool = True  # what a flight that ended early counts as

    def held(self, values: Floats) -> NDArray[np.bool_]:
        """Which values satisfy it; not-a-number never does."""
        return values < self.limit if self.below else values > self.limit


@dataclass(frozen=True)
class CampaignFacts:
    """What the resolved campaign file says, as far as a report repeats it."""

    name: str
    question: str
    controllers: tuple[str, ...]
    runs: int
    seed: int
    sampling: str
    dispersions: dict[str, dict[str, Any]]
    requirements: tuple[Requirement, ...]

    @property
    def independent(self) -> bool:
        """Whether its flights are independent draws, so that exact binomial statistics hold."""
        return self.sampling in INDEPENDENT_DESIGNS


@dataclass(frozen=True)
class ControllerFlights:
    """The flights of one controller, ascending by number."""

    flight: NDArray[np.int64]  # [flight]
    outcome: NDArray[np.str_]  # [flight]
    metrics: dict[str, Floats]  # name -> [flight]

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Which flights did not end as planned."""
        return self.outcome != "ok"


@dataclass(frozen=True)
class Envelope:
    """The bands of one channel of one controller over all flights."""

    time: Floats  # [time] s
    count: NDArray[np.int64]  # [time] flights still flying
    bands: dict[str, Floats]  # QUANTILE_COLUMNS -> [time]


@dataclass(frozen=True)
class Results:
    """Everything a report reads."""

    folder: Path
    campaign: CampaignFacts
    manifest: dict[str, Any]
    samples: dict[str, Floats]  # parameter -> [flight], flight k at index k
    flights: dict[str, ControllerFlights]
    envelopes: dict[tuple[str, str], Envelope]  # (controller, channel)
    reference: dict[str, Floats]  # "time" and REFERENCE_CHANNELS -> [time]
    nominal: dict[str, dict[str, Floats]]  # controller -> "time" and CHANNELS -> [time]

    @property
    def controllers(self) -> tuple[str, ...]:
        """Those that flew, in the campaign's order."""
        return tuple(name for name in self.campaign.controllers if name in self.flights)

    @property
    def metrics(self) -> tuple[str, ...]:
        """Metrics that the flights hold, in the order of the signal table, others after them."""
        held = next(iter(self.flights.values())).metrics
        known = [signal.name for signal in METRICS if signal.name in held]
        return (*known, *(name for name in held if name not in known))

    @property
    def pairs(self) -> Iterator[tuple[str, str]]:
        """The first controller against each other one."""
        first, *others = self.controllers
        return ((first, other) for other in others)


def _missing(path: Path, wanted: str) -> InputError:
    return InputError(path, None, None, "no such file", wanted)


def read_facts(path: Path) -> CampaignFacts:
    """The resolved campaign file of a folder. Raises InputError where it is missing or is not one."""
    from abhv_mc.campaign.check import read_campaign

    campaign = read_campaign(path)
    model, plain = campaign.model, campaign.document.data
    controllers = tuple(model.controllers)
    return CampaignFacts(
        name=model.name,
        question=model.question,
        controllers=controllers,
        runs=campaign.runs,
        seed=model.seed,
        sampling=model.sampling.design,
        dispersions=dict(plain.get("dispersions") or {}) if isinstance(plain, dict) else {},
        requirements=tuple(
            Requirement(
                metric=item.metric,
                limit=limit,
                below=item.below is not None,
                probability=item.probability,
                consumer_risk=item.consumer_risk,
                controllers=item.controllers or controllers[:1],
                early_is_failure=item.ended_early == "failure",
            )
            for item, limit in zip(model.requirements, campaign.limits, strict=True)
        ),
    )


def _columns(table: pa.Table, names: list[str] | None = None) -> dict[str, Any]:
    return {name: table[name].to_numpy(zero_copy_only=False) for name in names or table.column_names}


def _read(path: Path, wanted: str) -> pa.Table:
    if not path.is_file():
        raise _missing(path, wanted)
    try:
        return pq.read_table(path)
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(path, None, None, str(error).splitlines()[0], wanted) from None


def _read_flights(folder: Path) -> dict[str, ControllerFlights]:
    files = sorted((folder / "flights").glob("*.parquet"))
    if not files:
        raise _missing(folder / "flights", "at least one flown block (*.parquet)")
    table = pa.concat_tables([_read(file, "a block of flights") for file in files], promote_options="default")
    samples = [name for name in table.column_names if "." in name]
    metrics = [n for n in table.column_names if n not in ("flight", "controller", "outcome") and n not in samples]
    metrics = [name for name in metrics if pa.types.is_floating(table.schema.field(name).type)]
    table = table.sort_by("flight")
    names = np.asarray(table["controller"].cast(pa.string()).to_numpy(zero_copy_only=False), dtype=str)
    outcome = np.asarray(table["outcome"].cast(pa.string()).to_numpy(zero_copy_only=False), dtype=str)
    flight = table["flight"].to_numpy().astype(np.int64)
    columns = {name: table[name].to_numpy().astype(np.float64) for name in metrics}
    flown = {}
    for name in dict.fromkeys(names.tolist()):
        rows = np.flatnonzero(names == name)
        flown[name] = ControllerFlights(flight[rows], outcome[rows], {key: v[rows] for key, v in columns.items()})
    return flown


def _read_envelopes(path: Path) -> dict[tuple[str, str], Envelope]:
    columns = _columns(_read(path, "the envelopes of a campaign"))
    controller, channel = columns["controller"].astype(str), columns["channel"].astype(str)
    cells: dict[tuple[str, str], Envelope] = {}
    for key in dict.fromkeys(zip(controller.tolist(), channel.tolist(), strict=True)):
        rows = np.flatnonzero((controller == key[0]) & (channel == key[1]))
        rows = rows[np.argsort(columns["time"][rows], kind="stable")]
        bands = {name: columns[name][rows].astype(np.float64) for name in QUANTILE_COLUMNS}
        cells[key] = Envelope(columns["time"][rows].astype(np.float64), columns["count"][rows].astype(np.int64), bands)
    return cells


def _read_nominal(path: Path) -> dict[str, dict[str, Floats]]:
    columns = _columns(_read(path, "the nominal flight of each controller"))
    names = columns.pop("controller").astype(str)
    return {
        name: {key: value[names == name].astype(np.float64) for key, value in columns.items()}
        for name in dict.fromkeys(names.tolist())
    }


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a campaign's folder."""
    path = folder / "manifest.json"
    if not path.is_file():
        raise _missing(path, "the manifest of a campaign's folder")
    try:
        manifest: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(path, None, None, str(error), "JSON") from None
    return manifest


def read_results(folder: Path) -> Results:
    """Read a campaign's folder. Raises InputError where a file is missing or unreadable."""
    reference = _columns(_read(folder / "reference.parquet", "the mission's reference"))
    return Results(
        folder=folder,
        campaign=read_facts(folder / "campaign.yaml"),
        manifest=read_manifest(folder),
        samples={
            name: value.astype(np.float64)
            for name, value in _columns(_read(folder / "samples.parquet", "the samples of a campaign")).items()
            if name != "flight"
        },
        flights=_read_flights(folder),
        envelopes=_read_envelopes(folder / "envelopes.parquet"),
        reference={name: value.astype(np.float64) for name, value in reference.items()},
        nominal=_read_nominal(folder / "nominal.parquet"),
    )


def read_histories(folder: Path, controller: str) -> dict[int, dict[str, Floats]]:
    """The kept histories of one controller: flight -> "time" and channels -> [time]; empty where none are kept."""
    kept: dict[int, dict[str, Floats]] = {}
    for path in sorted((folder / "histories").glob("*.parquet")):
        table = pq.read_table(path, filters=[("controller", "=", controller)])
        if not table.num_rows:
            continue
        columns = _columns(table.drop_columns(["controller"]))
        numbers = columns.pop("flight")
        for number in np.unique(numbers):
            rows = np.flatnonzero(numbers == number)
            kept[int(number)] = {key: value[rows].astype(np.float64) for key, value in columns.items()}
    return kept
