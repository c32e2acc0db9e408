"""Campaign files of registered simulators; keys of systems with inputs in any units."""

import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, TypeGuard

from pydantic import Field, model_validator

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.config import Campaign, MetricName, Name
from abhv_mc.entry_points import SIMULATORS, find_entry_points, load_entry_point
from abhv_mc.flights.expressions import SourceRow, compile_expression
from abhv_mc.flights.metrics import MARGIN_NAMES, Bad, Metric, default_bad, label_of
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.parameters import Parameter, Parameters
from abhv_mc.flights.signals import Signal
from abhv_mc.flights.statistic import Statistic
from abhv_mc.interfaces import Simulator
from abhv_mc.io.documents import Document, Problems, StrictModel, YesNo
from abhv_mc.io.messages import Refusal, one_of, quoted
from abhv_mc.io.units import Time, check_angle, parse_in_any_unit

SYSTEMS = "systems"
_TAKEN = {
    "flight",
    "controller",
    "system",
    "outcome",
    "end_time",
    "end_time_s",
    "history",
    "error",
    "reason",
    "point",
}
_OUTCOMES = {Outcome.OK.code, Outcome.FAILED_TO_RUN.code}
Unit = Annotated[str, Field(min_length=1, max_length=30)]

InputName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_.]*$", max_length=60)]


class Quantity(StrictModel):
    """Quantity of a custom simulator."""

    unit: Unit = "-"
    """unit of the quantity, as free text; '-' if dimensionless"""
    doc: str = ""
    """description of the quantity in the report"""


class HistoryChannel(Quantity):
    """Column of the history that a flight returns."""

    circular: YesNo = False
    """whether the channel is an angle of which a full turn changes nothing, such as a heading;
    the unit must then be an angle, such as deg or rad"""

    @model_validator(mode="after")
    def _check_unit(self) -> "HistoryChannel":
        if self.circular:
            check_angle(self.unit)
        return self


class Input(Quantity):
    """Input of a flight for a custom simulator."""

    nominal: float = 0.0
    """nominal value, in the unit of the input"""
    seed: YesNo = False
    """whether the input is a random seed, an integer drawn for each flight"""


class Response(StrictModel):
    """Limit on an error after each step of a reference."""

    to: str
    """reference whose steps and ramps count: transients, a reference channel of the mission, or a
    channel of the histories"""
    within: Annotated[Time, Field(ge=0.0)]
    """time after the end of the step or ramp within which the error must be below the limit"""
    holds: Annotated[Time, Field(ge=0.0)]
    """time for which the error must then stay below the limit"""
    below: float | str
    """limit on the absolute value of the quantity in 'of'"""

    def write_formula(self, of: str, unit: str, steps: Sequence[float] = ()) -> str:
        """Return the formula for steps at known times (s), or at those of the channel ``to``."""
        limit = parse_in_any_unit(self.below, unit)
        holds = f"(always[0, {self.holds:g}](abs({of}) < {limit:.9g}))"
        after = [f"eventually[{step:.9g}, {step + self.within:.9g}]{holds}" for step in steps]
        default = f"always(step({self.to}) implies eventually[0, {self.within:g}]{holds})"
        return " and ".join(after) or default


class OwnMetric(Quantity):
    """Metric of a flight of a custom simulator."""

    of: str = ""
    """formula over the channels of the histories, or with 'response' a channel; default: the
    flight returns the metric"""
    response: Response | None = None
    """short form of a formula: response to the steps of a reference"""
    bad: Bad | None = None
    """which values are worse: high, low, or large in magnitude; default: high"""
    label: str | None = None
    """name of the metric in the report, without unit; default: the key"""

    def record(self, name: str, channels: Iterable[str]) -> Metric:
        """Return the metric as a record, in the same form as built-in metrics.

        Raise Refusal if its formula of the named channels is invalid.
        """
        of = self.of
        if self.response:
            of = self.response.write_formula(of, self.unit)
        if of:
            compile_expression(of, dict.fromkeys(channels, SourceRow("-", 0, 1.0)), 1.0)
        statistic = Statistic.ROBUSTNESS if of else Statistic.MAX
        return Metric(
            name=name,
            unit=self.unit,
            doc=self.doc,
            label=self.label or label_of(name, "-"),
            bad=self.bad or default_bad(statistic),
            group="user",
            of=of,
            statistic=statistic,
        )


class SystemsCampaign(Campaign):
    """Keys of a campaign that compares systems, with inputs and metrics in any units."""

    systems: Annotated[dict[Name, dict[str, Any]], Field(min_length=1)] = {"system": {}}
    """systems to compare, keyed by name, each with its own simulator settings"""
    inputs: dict[InputName, Input] = {}
    """inputs of a flight, by name"""
    metrics: Annotated[dict[MetricName, OwnMetric], Field(min_length=1)]
    """metrics that a flight returns, by name"""
    outcomes: dict[MetricName, str] = {}
    """reasons for early termination: one sentence for each code that a flight can return"""
    histories: dict[MetricName, HistoryChannel] = {}
    """channels of the time history by name; each flight returns them in addition to the time (s)"""

    @model_validator(mode="after")
    def _names(self) -> "SystemsCampaign":
        taken = {
            "inputs": _TAKEN,
            "metrics": {*_TAKEN, *MARGIN_NAMES, *self.inputs},
            "outcomes": _OUTCOMES,
        }
        taken["histories"] = {*_TAKEN, "time"}
        for key, names in taken.items():
            for name in getattr(self, key):
                if name in names:
                    expected = f"a name other than {quoted(sorted(names))}"
                    raise Refusal(f"the name '{name}' is already in use", expected, (key, name))
        return self

    @property
    def returned_channels(self) -> tuple[Signal, ...]:
        """Channels of the history that a flight returns."""
        return tuple(
            Signal(name, entry.unit, entry.doc, circular=entry.circular)
            for name, entry in self.histories.items()
        )

    @property
    def parameters(self) -> Parameters:
        """Parameters of the flights, defined by ``inputs``."""
        return Parameters(
            tuple(
                Parameter(n, e.unit, e.nominal, e.doc, of_user=True, seed=e.seed)
                for n, e in self.inputs.items()
            )
        )


def systems_key(data: Mapping[str, Any]) -> str:
    """Return the campaign-file key under which the compared systems are listed."""
    return SYSTEMS if is_own(data) else "controllers"


def is_own(data: object) -> TypeGuard[dict[str, Any]]:
    """Return whether a campaign uses a custom simulator or imported flights."""
    return isinstance(data, dict) and ("simulator" in data or "inputs" in data)


def read_systems(document: Document, model: SystemsCampaign, errors: Problems) -> "Contents":
    """Return the contents of a campaign file with systems; append problems to ``errors``."""
    if "envelopes" in model.keep.model_fields_set and not model.histories:
        problem = "envelopes cannot be computed without 'histories'"
        errors.add_key(("keep", "envelopes"), problem, "the key 'histories'")
    units = {channel.name: channel.unit for channel in model.returned_channels}
    metrics = []
    for name, entry in model.metrics.items():
        with errors.collect("metrics", name):
            # Installed simulators compute all metrics themselves.
            channels = () if isinstance(model, PackageCampaign) else units
            metrics.append(entry.record(name, channels))
    return Contents(
        systems=tuple(model.systems),
        parameters=model.parameters,
        metrics=tuple(metrics),
        units=units,
    )


class Installed(StrictModel):
    """Simulator of an installed package."""

    package: str
    """name under which a package registers its simulator"""


class PackageCampaign(SystemsCampaign):
    """Campaign file for the simulator of an installed package."""

    simulator: Installed
    """installed simulator that computes the flights"""


@dataclass(frozen=True)
class Contents:
    """What a campaign file states about its flights, as read by its simulator."""

    systems: tuple[str, ...]
    parameters: Parameters
    metrics: tuple[Metric, ...]  # metrics of each flight
    units: Mapping[str, str]  # unit of each channel of the histories
    margins: tuple[Metric, ...] = ()  # metrics of flights with margins
    kind: str = "system"  # noun for a compared system
    # names of channels without their units, by name
    stems: Mapping[str, str] = field(default_factory=dict)
    kept: tuple[str, ...] | None = None  # channels of stored histories; None: all
    enveloped: tuple[str, ...] | None = None  # channels of envelopes; None: all
    disturbances: tuple[str, ...] = ()  # parameters of noise, gusts and turbulence
    # outlines of keep-out zones [point, (latitude, longitude)], deg, by name
    zones: Mapping[str, Floats] = field(default_factory=dict)
    is_imported: bool = False  # whether a table states the inputs of each flight

    def margin_flights(self, runs: int) -> int:
        """Return the number of flights, out of ``runs``, for which margins are computed."""
        return 0

    def check(self, runs: int, errors: Problems) -> None:
        """Check entries that depend on the number of flights; append problems to ``errors``."""

    def read_limit(self, value: float | str, unit: str) -> float:
        """Return a limit of a requirement in the unit of its metric.

        Raise Refusal if the limit is invalid.
        """
        return parse_in_any_unit(value, unit)


@dataclass(frozen=True)
class Registered:
    """Simulator as an entry point of the group ``abhv_mc.simulators``.

    ``read`` checks the entries beyond ``keys``, appends problems to a list, and returns what the
    campaign file states about its flights.
    """

    make: Callable[[Any], Simulator]  # argument: the Experiment
    keys: type[Campaign] = PackageCampaign  # model of the campaign file
    read: Callable[[Document, Any, Problems], Contents] = read_systems
    # Return the document with names replaced, before its keys are checked.
    prepare: Callable[[Document], Document] = lambda document: document
    # models of the files to which a campaign file refers, as 'module:name' by the kind of file
    files: Mapping[str, str] = field(default_factory=dict)
    # Add the names of metrics, parameters and channels to a JSON Schema.
    enumerate_names: Callable[[dict[str, Any]], None] = lambda schema: None
    metrics: tuple[str, ...] = ()  # names of metrics that need no declaration
    version: Callable[[], str] = lambda: ""  # line of `abhv-mc --version`, or ''


def name_simulator(data: object) -> str:
    """Return the name under which the simulator of a campaign file is registered."""
    if not is_own(data):
        return "vehicle"
    if "simulator" not in data:
        return "table"
    entry = data["simulator"]
    if isinstance(entry, dict) and "package" in entry:
        return str(entry["package"])
    return "command" if isinstance(entry, dict) and "command" in entry else "python"


def find_simulator(document: Document) -> Registered:
    """Return the simulator that a campaign file names.

    Raise InputError if no installed package registers it.
    """
    name = name_simulator(document.data)
    if name in find_entry_points(SIMULATORS):
        try:
            return _load(name)
        except Exception as error:
            reason = f"it cannot be imported ({type(error).__name__}: {error})"
    else:
        reason = "no installed package registers it"
    where = ("simulator", "package") if is_own(document.data) else ()
    expected = one_of(find_entry_points(SIMULATORS), name)
    raise document.error(where, f"the simulator '{name}' is not available: {reason}", expected)


def load_simulators() -> dict[str, Registered]:
    """Return the registered simulators by name, except those that cannot be imported."""
    simulators = {}
    for name in find_entry_points(SIMULATORS):
        with contextlib.suppress(Exception):
            simulators[name] = _load(name)
    return simulators


def _load(name: str) -> Registered:
    """Return a registered simulator; a class alone has the default keys."""
    entry = load_entry_point(SIMULATORS, name)
    return entry if isinstance(entry, Registered) else Registered(entry)
