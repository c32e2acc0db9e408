"""The campaign file as a model: keys, types and what can be checked within one entry."""

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from abhv_mc.campaign.file.own_metrics import MetricEntry, MetricName
from abhv_mc.campaign.file.tuning import Tune
from abhv_mc.campaign.sampling.designs import DESIGNS
from abhv_mc.campaign.sampling.distributions import Distribution, Value
from abhv_mc.flight.signals import CHANNEL_INDEX, STANDARD_CHANNELS
from abhv_mc.io.documents import File, Refusal, StrictModel, describe, one_of
from abhv_mc.io.units import FREQUENCY, TIME, Time, parse_quantity

PROCESSES, THREADS = "processes", "threads"
_ALL_CHANNELS = tuple(CHANNEL_INDEX)
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=80)]


_MOST_WORKERS = 1024
_LARGEST_BATCH = 2**20


def _auto(value: Any, most: int) -> int | None:
    if value == "auto":
        return None
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= most:
        raise Refusal(describe(value), f"'auto' or a whole number from 1 to {most}")
    return value


def _auto_up_to(most: int) -> Any:
    """A field of a whole number up to ``most``, or None for "auto"."""
    written = Literal["auto"] | Annotated[int, Field(ge=1, le=most)]
    return BeforeValidator(lambda value: _auto(value, most), json_schema_input_type=written)


Workers = Annotated[int | None, _auto_up_to(_MOST_WORKERS)]
Batch = Annotated[int | None, _auto_up_to(_LARGEST_BATCH)]


DesignName = Literal["random", "lhs", "sobol", "halton", "saltelli", "corners", "grid", "one_at_a_time", "file"]


class Sampling(StrictModel):
    """The design; in the file, its name alone will do."""

    design: DesignName = "random"
    levels: Annotated[int, Field(ge=2, le=1000)] = 2  # of each parameter in a grid or one_at_a_time
    path: File | None = None  # CSV or Parquet with one column per parameter, for the design "file"

    @model_validator(mode="after")
    def _path_for_a_file(self) -> "Sampling":
        if (self.design == "file") != (self.path is not None):
            raise Refusal(
                f"design '{self.design}' {'without' if self.path is None else 'with'} a path", "a path for 'file' only"
            )
        return self


def _sampling(value: Any) -> Any:
    if isinstance(value, str):
        if value not in DESIGNS:
            raise Refusal(f"'{value}'", one_of(DESIGNS, value))
        return {"design": value}
    return value


class Correlation(StrictModel):
    """Correlation of two parameters, of their ranks (Spearman) or of the normal numbers behind them."""

    between: tuple[str, str]
    rank: Annotated[float, Field(gt=-1.0, lt=1.0)] | None = None
    normal: Annotated[float, Field(gt=-1.0, lt=1.0)] | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> "Correlation":
        if (self.rank is None) == (self.normal is None):
            raise Refusal("both" if self.rank is not None else "neither", "either 'rank' or 'normal'")
        if self.between[0] == self.between[1]:
            raise Refusal(f"'{self.between[0]}' twice", "two different parameters", ("between",))
        return self


class Requirement(StrictModel):
    """Probability with which a metric must be below (or above) a limit."""

    metric: str
    below: Value | None = None
    above: Value | None = None
    probability: Annotated[float, Field(gt=0.0, lt=1.0)]
    consumer_risk: Annotated[float, Field(gt=0.0, lt=0.5)] = 0.10
    controllers: tuple[str, ...] | None = None  # the first of the campaign by default
    ended_early: Literal["failure", "as_measured"] = "failure"  # what a flight that ended early counts as

    @property
    def early_is_failure(self) -> bool:
        """Whether a flight that ended early fails, whatever its metric was until then."""
        return self.ended_early == "failure"

    @model_validator(mode="after")
    def _one_limit(self) -> "Requirement":
        if (self.below is None) == (self.above is None):
            raise Refusal("both" if self.below is not None else "neither", "either 'below' or 'above'")
        return self


def _rate(value: Any) -> Any:
    rate = parse_quantity(value, FREQUENCY)
    if rate <= 0.0:
        raise Refusal(describe(value), "a rate above zero such as '10 Hz'")
    return rate


Rate = Annotated[float, BeforeValidator(_rate, json_schema_input_type=str)]


def _as_list(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


def _channels(value: Any) -> Any:
    if value == ["all"]:
        return list(CHANNEL_INDEX)
    for i, name in enumerate(value):
        if name not in CHANNEL_INDEX:
            raise Refusal(f"channel {describe(name)}", one_of(["all", *CHANNEL_INDEX], name), (i,))
    return sorted(set(value), key=CHANNEL_INDEX.__getitem__)


Channels = Annotated[
    tuple[str, ...],
    BeforeValidator(_channels),
    BeforeValidator(_as_list, json_schema_input_type=str | list[str]),
]


def _flights(value: tuple[int | str, ...]) -> tuple[int | str, ...]:
    for i, item in enumerate(value):
        words = str(item).split()
        number = len(words) == 2 and words[0] in ("worst", "every") and words[1].isdecimal() and int(words[1]) > 0
        if not (isinstance(item, int) and item >= 0) and item not in ("failed", "all", "none") and not number:
            where = (i,) if len(value) > 1 else ()
            raise Refusal(describe(item), "all, none, failed, 'worst 20', 'every 100' or a flight's number", where)
    return value


class KeepHistories(StrictModel):
    """Which flights are written at full length: the union of what ``flights`` names."""

    flights: Annotated[
        tuple[int | str, ...],
        AfterValidator(_flights),
        BeforeValidator(_as_list, json_schema_input_type=int | str | list[int | str]),
    ] = ("worst 20",)
    by: str = "altitude_error_max_m"  # the metric that "worst" goes by; flights that ended early come first
    channels: Channels = _ALL_CHANNELS
    rate: Rate = 10.0


class KeepEnvelopes(StrictModel):
    """What the envelopes over all flights cover."""

    channels: Channels = STANDARD_CHANNELS
    rate: Rate = 5.0


class Keep(StrictModel):
    """What a campaign writes besides metrics."""

    histories: KeepHistories = KeepHistories()
    envelopes: KeepEnvelopes = KeepEnvelopes()


def _points(value: Any) -> Any:
    if value == []:
        raise Refusal("no point", "trim, or times of the flight such as 30 s")
    return ["trim" if item == "trim" else parse_quantity(item, TIME) for item in _as_list(value)]


Points = Annotated[
    tuple[Literal["trim"] | float, ...], BeforeValidator(_points, json_schema_input_type=str | list[str])
]


def _flight_count(value: Any) -> Any:
    if value == "all":
        return None
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise Refusal(describe(value), "'all' or a whole number from 1")
    return value


class MarginsOfFlights(StrictModel):
    """Of which flights stability margins are found, and where."""

    at: Points = ("trim",)
    flights: Annotated[  # the first so many; None for all
        int | None, BeforeValidator(_flight_count, json_schema_input_type=Literal["all"] | int)
    ] = 100

    def of(self, runs: int) -> int:
        """How many of so many flights."""
        return runs if self.flights is None else min(self.flights, runs)


class Stop(StrictModel):
    """When to stop before ``runs`` flights; in the file, ``when proven`` will do."""

    when: Literal["proven"]
    looks: Annotated[tuple[Annotated[int, Field(ge=1)], ...], Field(min_length=1)] | None = None  # flights, ascending

    @model_validator(mode="after")
    def _ascending(self) -> "Stop":
        looks = self.looks or ()
        for i, (before, look) in enumerate(pairwise(looks)):
            if look <= before:
                raise Refusal(f"{look} after {before}", "numbers of flights that ascend", ("looks", i + 1))
        return self


def _stop(value: Any) -> Any:
    if isinstance(value, str):
        if value != "when proven":
            raise Refusal(describe(value), "'when proven', or nothing")
        return {"when": "proven"}
    return value


class Family(StrictModel):
    """All pairs of requirement and controller together: the chance of any false PASS among them."""

    method: Literal["holm"] = "holm"  # where the campaign stops when proven: Bonferroni
    risk: Annotated[float, Field(gt=0.0, lt=0.5)] = 0.10


class Execution(StrictModel):
    """How it is flown; no result depends on it."""

    workers: Workers = None
    batch: Batch = None  # flights of a block
    isolation: Literal["auto", "processes", "threads"] = "auto"  # what a flight that hangs or crashes may take along
    flight_time_limit: Annotated[Time, Field(gt=0.0)] = 10.0  # s


def _metrics_kind(value: Any) -> str:
    return "file" if isinstance(value, str | Path) else "entries"


class Campaign(StrictModel):
    """A campaign file."""

    name: Name
    question: str = ""
    vehicle: File
    mission: File
    controllers: Annotated[dict[Name, File], Field(min_length=1)]
    runs: Annotated[int, Field(ge=1, le=2**30)] | None = None  # None where the design knows its number
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    sampling: Annotated[Sampling, BeforeValidator(_sampling, json_schema_input_type=str | Sampling)] = Sampling()
    dispersions: dict[str, Distribution] = {}
    correlations: tuple[Correlation, ...] = ()
    channels: File | None = None  # Python file of channels of one's own
    metrics: Annotated[
        Annotated[dict[MetricName, MetricEntry], Tag("entries")] | Annotated[File, Tag("file")],
        Discriminator(_metrics_kind),
    ] = {}
    requirements: tuple[Requirement, ...] = ()
    margins: MarginsOfFlights | None = None
    stop: Annotated[Stop | None, BeforeValidator(_stop, json_schema_input_type=str | Stop | None)] = None
    tune: Tune | None = None  # of `abhv-mc tune`; no flight of the campaign depends on it
    family: Family | None = None  # each requirement has its own risk by default
    keep: Keep = Keep()
    execution: Execution = Execution()
