"""Campaign file of the built-in simulator: keys, checks, and files to which it refers."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag

from abhv_mc.campaign.file.config import (
    ALL,
    Campaign,
    FlightCount,
    Keep,
    KeepEnvelopes,
    KeepHistories,
    MetricName,
    Name,
    as_list,
)
from abhv_mc.campaign.file.systems import Contents
from abhv_mc.campaign.sampling.derived_parameters import DOTTED
from abhv_mc.flights.metrics import MARGIN_NAMES, MARGINS, Metric
from abhv_mc.io.documents import (
    Document,
    File,
    Problems,
    StrictModel,
    read_document,
    validate,
)
from abhv_mc.io.messages import InputError, Refusal, counted, grouped_digits, one_of
from abhv_mc.io.units import dimension_of, parse_quantity, parse_unit
from abhv_mc.shipped import shipped_files
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.flight.channels import (
    CHANNEL_INDEX,
    CHANNELS,
    STANDARD_CHANNELS,
    effector_channels,
    state_channels,
)
from abhv_mc_vehicle.flight.metrics import METRICS, effector_metrics
from abhv_mc_vehicle.flight.vehicle_parameters import read_vehicle_parameters
from abhv_mc_vehicle.kernel.plant.vehicle import EFFECTORS, ENGINES, MEMBER
from abhv_mc_vehicle.plant.parameters import DISTURBANCES, OURS
from abhv_mc_vehicle.user_code.effector_commands import find_driven
from abhv_mc_vehicle.vehicle_simulator.keep_out import Zone
from abhv_mc_vehicle.vehicle_simulator.references import check_kinds
from abhv_mc_vehicle.vehicle_simulator.tuning import Points, Tune
from abhv_mc_vehicle.vehicle_simulator.user_metrics import (
    MetricEntry,
    MetricsFile,
    declare_metrics,
    find_user_channels,
)


class MarginsOfFlights(StrictModel):
    """Flights and times for which stability margins are computed."""

    at: Points = ("trim",)
    """points at which margins are computed: 'trim', a time of the flight such as 30 s, or a list
    of these"""
    flights: FlightCount = 100
    """number of flights, counted from the first, for which margins are computed; or 'all'"""

    def of(self, runs: int) -> int:
        """Return the number of flights, out of ``runs``, for which margins are computed."""
        return runs if self.flights is None else min(self.flights, runs)


def find_shipped(document: Document, kind: str, value: Any) -> Any:
    """Return the path of the shipped file that an entry names, or the entry of other files."""
    if not isinstance(value, str) or document.resolve(value).is_file():
        return value
    return str(shipped_files(kind).get(value, value))


def _shipped(kind: str) -> BeforeValidator:
    return BeforeValidator(lambda value, info: find_shipped(info.context["document"], kind, value))


def _in_order(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(name for name in CHANNEL_INDEX if name in names or ALL in names)


def _metrics_kind(value: Any) -> str:
    return "file" if isinstance(value, str | Path) else "entries"


Channels = Annotated[
    tuple[Literal[(ALL, *CHANNEL_INDEX)], ...],  # type: ignore[valid-type]
    AfterValidator(_in_order),
    BeforeValidator(as_list, json_schema_input_type=str | list[str]),
]


class VehicleHistories(KeepHistories):
    """Flights and channels whose histories are stored."""

    channels: Annotated[
        tuple[str, ...], BeforeValidator(as_list, json_schema_input_type=str | list[str])
    ] = (ALL,)
    """names of channels, or 'all'; each effector with an actuator has its own channels"""


class VehicleEnvelopes(KeepEnvelopes):
    """Channels and rate of the time-history envelopes over all flights."""

    channels: Channels = STANDARD_CHANNELS
    """names of channels, or 'all'"""


class VehicleKeep(Keep):
    """Outputs that a campaign stores in addition to metrics."""

    histories: VehicleHistories = VehicleHistories()
    """flights whose full time histories are stored"""
    envelopes: VehicleEnvelopes = VehicleEnvelopes()
    """time-history envelopes over all flights"""


_Grid = dict[str, Annotated[list[Any], BeforeValidator(as_list, json_schema_input_type=Any)]]


class VehicleCampaign(Campaign):
    """Campaign file of the built-in simulator of a vehicle."""

    vehicle: Annotated[File, _shipped("vehicle")]
    """vehicle file, relative to the campaign file, or a shipped name"""
    mission: Annotated[File, _shipped("mission")]
    """mission file, relative to the campaign file, or a shipped name"""
    controllers: Annotated[dict[Name, Annotated[File, _shipped("control")]], Field(min_length=1)]
    """controller files or shipped names by name; all controllers are simulated with the same
    samples"""
    variants: Annotated[
        list[_Grid], BeforeValidator(as_list, json_schema_input_type=_Grid | list[_Grid])
    ] = []
    """further controllers, with other values of entries in controller files: all combinations of
    lists, such as {tlc.altitude.bandwidth: [0.02, 0.05]}, or a list of such mappings; a number has
    the unit of the entry that it replaces"""
    channels: File | None = None
    """Python file of custom channels, relative to the campaign file"""
    metrics: Annotated[
        Annotated[dict[MetricName, MetricEntry], Tag("entries")] | Annotated[File, Tag("file")],
        Discriminator(_metrics_kind),
    ] = {}
    """custom metrics by name, or a file of metrics"""
    keep_out: dict[MetricName, Zone] = {}
    """zones that flights must not enter, by name; the metric distance_from_NAME_m is the
    smallest distance of the ground track, negative inside"""
    margins: MarginsOfFlights | None = None
    """stability margins of dispersed flights as metrics; default: margins of the nominal vehicle
    and at the corners of the dispersions"""
    keep: VehicleKeep = VehicleKeep()
    """outputs to store in addition to the metrics of every flight"""
    tune: Tune | None = None
    """free parameters, objective and limits of `abhv-mc tune`; flights do not depend on them"""
    figures: Literal["paper"] | None = None
    """'paper': the report reproduces the figures of Zhu and Shen (2014) and lists the values
    published there"""


@dataclass(frozen=True)
class VehicleContents(Contents):
    """What a campaign file states about the flights of a vehicle."""

    kind: str = "controller"
    document: Document = None  # type: ignore[assignment]
    model: VehicleCampaign = None  # type: ignore[assignment]
    declared: tuple[Metric, ...] = ()
    user_sources: tuple[tuple[str, str], ...] = ()  # name and unit of each custom channel
    effectors: tuple[str, ...] = ()  # effectors of the vehicle that have actuators
    states: tuple[tuple[str, str, bool], ...] = ()  # names, units and circularity of custom states

    def margin_flights(self, runs: int) -> int:
        return self.model.margins.of(runs) if self.model.margins else 0

    def read_limit(self, value: float | str, unit: str) -> float:
        """Return a limit in the metric's unit; plain numbers are taken to be in this unit."""
        if isinstance(value, float):
            return value
        if unit in ("g", "dB"):
            raise Refusal(f"found '{value}'", f"a plain number, in {unit}")
        return parse_quantity(value, dimension_of(unit), bare_unit=unit) / parse_unit(unit)[0]

    def check(self, runs: int, errors: Problems) -> None:
        """Check the points and flights for which stability margins are computed.

        Points must lie within the mission. A requirement on margins needs the margins of all
        flights.
        """
        model = self.model
        needed = [i for i, entry in enumerate(model.requirements) if entry.metric in MARGIN_NAMES]
        if model.margins is None:
            for i in needed:
                problem = (
                    f"the requirement on '{model.requirements[i].metric}' needs stability margins"
                )
                expected = "'margins: {at: [trim], flights: all}' in the campaign file"
                errors.add(("requirements", i, "metric"), problem, expected)
            return
        if needed and model.margins.of(runs) < runs:
            metric = model.requirements[needed[0]].metric
            problem = (
                f"margins are computed for only {grouped_digits(model.margins.of(runs))} of "
                f"{counted(runs, 'flight')}, but '{metric}' is required"
            )
            expected = "'flights: all', because a verdict needs the metric of every flight"
            errors.add(("margins", "flights"), problem, expected)
        times = {i: time for i, time in enumerate(model.margins.at) if time != "trim"}
        duration = 0.0
        if times:
            duration = read_mission(model.mission).duration
        for i, time in times.items():
            if not 0.0 <= time <= duration:
                errors.add(
                    ("margins", "at", i),
                    f"found {time:g} s",
                    f"'trim', or a mission time from 0 to {duration:g} s",
                )


def read_contents(document: Document, model: VehicleCampaign, errors: Problems) -> VehicleContents:
    """Return the contents of a campaign file; append problems to ``errors``.

    Raise InputErrors if a file of the campaign is invalid.
    """
    check_kinds(document, model)
    parameters, states = read_vehicle_parameters(model.vehicle, model.controllers.values())
    user_channels = find_user_channels(model.channels) if model.channels else ()
    effectors = find_driven(model.vehicle, model.controllers.values())
    declared = _declare_metrics(
        document, model, user_channels, errors, effectors=effectors, states=states
    )
    units = {c.name: c.unit for c in (*CHANNELS, *effector_channels(effectors))}
    known = [ALL, *units, *(channel.name for channel in state_channels(states))]
    for name in model.keep.histories.channels:
        if name not in known:
            where = ("keep", "histories", "channels")
            errors.add(where, f"unknown channel '{name}'", one_of(known, name))
    return VehicleContents(
        systems=tuple(model.controllers),
        parameters=parameters,
        metrics=(*METRICS, *declared),
        units=units | dict(user_channels),
        margins=MARGINS,
        disturbances=DISTURBANCES,
        stems={c.name: c.name.rpartition("_")[0] or c.name for c in CHANNELS},
        kept=None if ALL in model.keep.histories.channels else model.keep.histories.channels,
        enveloped=model.keep.envelopes.channels,
        zones={name: zone.outline() for name, zone in model.keep_out.items()},
        document=document,
        model=model,
        declared=declared,
        user_sources=user_channels,
        effectors=effectors,
        states=states,
    )


def _declare_metrics(
    document: Document,
    model: VehicleCampaign,
    user_channels: Sequence[tuple[str, str]],
    errors: Problems,
    *,
    effectors: tuple[str, ...],
    states: tuple[tuple[str, str, bool], ...],
) -> tuple[Metric, ...]:
    """Return the records of custom metrics. The file of custom channels is not run."""
    location: tuple[str, ...] = ("metrics",)
    entries = model.metrics
    source = document
    if isinstance(entries, Path):
        source = read_document(entries)
        entries = validate(source, MetricsFile).root
        location = ()
    zones = {f"distance_from_{name}_m": zone.metric(name) for name, zone in model.keep_out.items()}
    for name in zones.keys() & entries.keys():
        errors.append(
            source.key_error(
                (*location, name),
                f"the metric '{name}' belongs to a zone of 'keep_out'",
                "another name",
            )
        )
    entries = entries | zones
    needs_mission = any(entry.phase or entry.response for entry in entries.values())
    own = declare_metrics(
        entries,
        user_channels,
        source,
        location,
        errors,
        mission=read_mission(model.mission) if needs_mission else None,
        effectors=effectors,
        states=states,
    )
    return (*effector_metrics(effectors), *own)


def draw_members(document: Document) -> Document:
    """Return the campaign with a distribution of the members of the mission's ensemble.

    The distribution has the weights of the members. A campaign that disperses the member is
    unchanged.
    """
    data = document.entries
    parts = [data.get(key) or {} for key in ("dispersions", "unknowns", "derived")]
    mission = data.get("mission")
    if not (isinstance(mission, str) and all(isinstance(part, dict) for part in parts)):
        return document  # The pydantic models report the invalid entry.
    if any(MEMBER in part for part in parts):
        return document
    try:
        _, weights = read_mission(
            document.resolve(find_shipped(document, "mission", mission))
        ).read_members()
    except InputError:
        return document  # The error is reported when the mission is read.
    if not weights.size:
        return document
    values = list(range(1, 1 + len(weights)))
    drawn = {"distribution": "discrete", "values": values, "weights": weights.tolist()}
    return replace(document, data=data | {"dispersions": parts[0] | {MEMBER: drawn}})


def name_effectors(document: Document) -> Document:
    """Return the campaign with the names of effectors and engines replaced by indices.

    ``failure.right_elevon.stuck_time`` becomes ``failure.effector_0.stuck_time`` if the vehicle
    file lists right_elevon first.
    """
    data = document.entries
    try:
        vehicle = document.resolve(find_shipped(document, "vehicle", data["vehicle"]))
        content: Any = read_document(vehicle).data
        parts = (
            (content.get("effectors", {}), EFFECTORS),
            ((content.get("propulsion") or {}).get("engines", {}), ENGINES),
        )
        indices = {
            name: index
            for names, entries in parts
            for name, index in zip(names, entries, strict=False)
        }
    except (InputError, KeyError, TypeError, AttributeError):
        return document  # The pydantic models report the invalid entry.

    def renamed(text: str) -> str:
        group, _, suffix = text.partition(".")
        effector = suffix.partition(".")[0].removesuffix("_effectiveness")
        is_final = group not in ("failure", "control") or text in OURS or effector not in indices
        return text if is_final else f"{group}.{indices[effector]}{suffix[len(effector) :]}"

    def rename(value: Any) -> Any:
        if isinstance(value, dict):
            return {rename(key): rename(inner) for key, inner in value.items()}
        if isinstance(value, list):
            return [rename(inner) for inner in value]
        return (
            DOTTED.sub(lambda match: renamed(match[0]), value) if isinstance(value, str) else value
        )

    keys = ("dispersions", "unknowns", "derived", "correlations")
    return replace(
        document, data={**data, **{key: rename(data[key]) for key in keys if key in data}}
    )
