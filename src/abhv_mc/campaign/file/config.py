"""Pydantic model of the campaign file: keys, types and checks within one entry."""

import re
from collections.abc import Collection
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from abhv_mc.campaign import MOST_WORKERS
from abhv_mc.campaign.file.unknowns import Unknown, UnknownPoints
from abhv_mc.campaign.sampling.distributions import Distribution, Value
from abhv_mc.io.documents import File, StrictModel
from abhv_mc.io.messages import Refusal, found_value
from abhv_mc.io.units import Fraction, Frequency, Time

ALL = "all"
BY_REQUIREMENTS = "requirements"


Rate = Annotated[Frequency, Field(gt=0.0)]


def as_list(value: Any) -> Any:
    """Return a list unchanged, and any other value as a list of this value."""
    return value if isinstance(value, list) else [value]


def _flights(value: tuple[int | str, ...]) -> tuple[int | str, ...]:
    for i, item in enumerate(value):
        number = isinstance(item, int) and item >= 0
        if not number and not re.fullmatch(
            r"failed|all|none|(worst|every) +0*[1-9][0-9]*", str(item)
        ):
            raise Refusal(
                found_value(item),
                "'all', 'none', 'failed', 'worst 20', 'every 100' or a flight number",
                (i,) if len(value) > 1 else (),
            )
    return value


class KeepHistories(StrictModel):
    """Flights whose histories are stored: the union of the entries of ``flights``."""

    flights: Annotated[
        tuple[int | str, ...],
        AfterValidator(_flights),
        BeforeValidator(as_list, json_schema_input_type=int | str | list[int | str]),
    ] = ("worst 20",)
    """'all', 'none', 'failed', 'worst 20', 'every 100', a flight number, or a list of these"""
    by: str = BY_REQUIREMENTS
    """criterion for 'worst': requirements (the largest exceedance of a limit, relative to the
    limit) or a metric; early terminations come first"""
    rate: Rate = 10.0
    """samples per second of flight"""


class KeepEnvelopes(StrictModel):
    """Time-history envelopes over all flights."""

    rate: Rate = 5.0
    """time bins per second of flight"""


class Keep(StrictModel):
    """Outputs that a campaign stores in addition to metrics."""

    histories: KeepHistories = KeepHistories()
    """flights whose full time histories are stored"""
    envelopes: KeepEnvelopes = KeepEnvelopes()
    """time-history envelopes over all flights"""


TRACED = (
    "id",
    "text",
    "source",
    "rationale",
)  # keys that document the origin of a requirement
PROCESSES, THREADS = "processes", "threads"

_LARGEST_BATCH = 2**20


def _none_for(word: str, most: int | None = None) -> Any:
    """Return a validator that converts ``word`` in the file to None in the model."""
    written = Literal[word] | Annotated[int, Field(ge=1, le=most)]  # type: ignore[valid-type]

    def read(value: Any) -> Any:
        if value is None:
            raise Refusal("found nothing", f"'{word}' or a whole number")
        return None if value == word else value

    return BeforeValidator(read, json_schema_input_type=written)


Workers = Annotated[
    Annotated[int, Field(ge=1, le=MOST_WORKERS)] | None, _none_for("auto", MOST_WORKERS)
]
Batch = Annotated[
    Annotated[int, Field(ge=1, le=_LARGEST_BATCH)] | None, _none_for("auto", _LARGEST_BATCH)
]
FlightCount = Annotated[Annotated[int, Field(ge=1)] | None, _none_for("all")]
MetricName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=60)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+=-]*$", max_length=120)]
DesignName = Literal["random", "lhs", "sobol", "halton", "corners", "grid", "one_at_a_time", "file"]


class Sampling(StrictModel):
    """Sampling design; in a campaign file, the name of the design may replace the mapping."""

    design: DesignName = "random"
    """name of the sampling design"""
    levels: Annotated[int, Field(ge=2, le=1000)] = 2
    """number of values per parameter in the designs 'grid' and 'one_at_a_time'"""
    path: File | None = None
    """CSV or Parquet file for the design 'file', with one column per parameter in SI units"""

    @model_validator(mode="after")
    def _path_for_a_file(self) -> "Sampling":
        if (self.design == "file") != (self.path is not None):
            raise Refusal(
                f"the key 'path' does not fit the design '{self.design}'",
                "a path if, and only if, the design is 'file'",
            )
        return self


def _sampling(value: Any) -> Any:
    return {"design": value} if isinstance(value, str) else value


class Correlation(StrictModel):
    """Spearman's rank correlation or normal correlation of two parameters."""

    between: tuple[str, str]
    """the two correlated parameters"""
    rank: Annotated[float, Field(gt=-1.0, lt=1.0)] | None = None
    """rank correlation (Spearman); give either 'rank' or 'normal'"""
    normal: Annotated[float, Field(gt=-1.0, lt=1.0)] | None = None
    """correlation of the two normal variables in the Gaussian copula; give either 'rank' or
    'normal'"""

    @model_validator(mode="after")
    def _one_of_both(self) -> "Correlation":
        if (self.rank is None) == (self.normal is None):
            raise Refusal(
                "both 'rank' and 'normal' are set"
                if self.rank is not None
                else "neither 'rank' nor 'normal' is set",
                "either 'rank' or 'normal'",
            )
        if self.between[0] == self.between[1]:
            raise Refusal(
                f"'{self.between[0]}' is listed twice", "two different parameters", ("between",)
            )
        return self


class RequirementEntry(StrictModel):
    """Requirement on the probability that a metric lies below, above or between limits."""

    metric: str
    """name of the metric to which the limits apply"""
    below: Value | None = None
    """upper limit of the metric, in the metric's unit"""
    above: Value | None = None
    """lower limit of the metric, in the metric's unit; with 'below' and 'above' the metric must
    lie between the limits"""
    probability: Annotated[Fraction, Field(gt=0.0, lt=1.0)]
    """required probability that a flight meets the limits, such as 99.73 %"""
    consumer_risk: Annotated[Fraction, Field(gt=0.0, lt=0.5)] = 0.10
    """consumer's risk: largest probability that a system just short of the requirement ever gets
    the verdict PASS"""
    producer_risk: Annotated[Fraction, Field(gt=0.0, lt=0.5)] | None = None
    """producer's risk: largest probability that a system that just meets the requirement ever
    gets the verdict FAIL; default: the consumer's risk"""
    controllers: tuple[str, ...] | None = None
    """controllers that must meet the requirement; default: 'under_test' of the campaign"""
    ended_early: Literal["failure", "as_measured"] = "failure"
    """how a flight that terminates early is counted: as a failure, or by its measured value"""
    id: str | None = None
    """identifier of the requirement, such as GNC-12; shown in all outputs"""
    text: str | None = None
    """text of the requirement in the source document"""
    source: str | None = None
    """source document of the requirement"""
    rationale: str | None = None
    """rationale of the requirement"""

    @model_validator(mode="after")
    def _some_limit(self) -> "RequirementEntry":
        if self.below is None and self.above is None:
            raise Refusal("neither 'below' nor 'above' is set", "'below', 'above' or both")
        return self


class PooledSeed(StrictModel):
    """Seed and number of flights of one member of a pooled campaign."""

    seed: Annotated[int, Field(ge=0, lt=2**63)]
    """seed of the samples"""
    runs: Annotated[int, Field(ge=1)]
    """number of flights, counted from flight 0"""


class Family(StrictModel):
    """Risk of at least one false PASS among all pairs of a requirement and a controller."""

    method: Literal["holm"] = "holm"
    """correction for multiple verdicts: Holm's step-down procedure"""
    risk: Annotated[Fraction, Field(gt=0.0, lt=0.5)] = 0.10
    """largest probability that at least one PASS is false"""


class Execution(StrictModel):
    """Execution settings, which do not affect any result."""

    workers: Workers = None
    """number of blocks of flights computed in parallel; auto: one per core"""
    batch: Batch = None
    """number of flights in a block"""
    isolation: Literal["auto", "processes", "threads"] = "auto"
    """isolation of flights: with processes, a flight that crashes or hangs does not affect other
    flights; auto: threads for small campaigns without custom code, otherwise processes"""
    flight_time_limit: Annotated[Time, Field(gt=0.0)] | None = None
    """limit on the processor time (on a cluster: wall time) per 16 flights; flights that exceed
    the limit count as hanging; default: 20 times the time of 16 nominal flights computed one by
    one, including margins, and at least 30 s"""


class Compared(StrictModel):
    """Controllers that a campaign compares."""

    compare: Annotated[tuple[Name, ...], Field(min_length=2)]
    """controllers to compare"""


def select_asked(data: dict[str, Any], controllers: Collection[str]) -> dict[str, Any]:
    """Return the data of a campaign with its comparison restricted to ``controllers``.

    The comparison is removed if fewer than two of the compared controllers remain.
    """
    asks = data.get("asks")
    if not isinstance(asks, dict):
        return data
    compared = [name for name in asks["compare"] if name in controllers]
    return {**data, "asks": {"compare": compared} if len(compared) > 1 else None}


def _asks_kind(value: Any) -> str:
    return "answer" if isinstance(value, str) else "controllers"


class Campaign(StrictModel):
    """Keys that the campaign files of all simulators have."""

    name: Name
    """name of the campaign and of its results folder in reports/"""
    question: str = ""
    """question that the campaign answers; headline of the report"""
    author: str = ""
    """person or organization responsible for the campaign, named at the start of the report"""
    asks: (
        Annotated[
            Annotated[Literal["drivers", "margins", "worst"], Tag("answer")]
            | Annotated[Compared, Tag("controllers")],
            Discriminator(_asks_kind),
        ]
        | None
    ) = None
    """topic of the report's first sentence: {compare: [controllers]}, drivers, margins or worst;
    default: whether the requirements are met"""
    under_test: Annotated[tuple[Name, ...], Field(min_length=1)] | None = None
    """controllers under test, which must meet the requirements without 'controllers'; the exit
    code depends on their verdicts; default: all controllers"""
    runs: Annotated[int, Field(ge=1, le=2**30)] | None = None
    """number of flights per controller; omitted if the design determines the number"""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """seed of all random samples; equal seeds give equal flights"""
    pooled: tuple[PooledSeed, ...] = ()
    """seeds of the campaigns joined by `abhv-mc merge`, in order; default: one seed"""
    sampling: Annotated[
        Sampling, BeforeValidator(_sampling, json_schema_input_type=DesignName | Sampling)
    ] = Sampling()
    """sampling design: a name, or a mapping with its settings; verdicts need 'random'"""
    dispersions: dict[str, Distribution] = {}
    """distributions of the dispersed parameters, by parameter name"""
    unknowns: dict[str, Unknown] = {}
    """bounds of parameters that have a fixed but unknown value for the whole programme;
    requirements are judged at points within these bounds"""
    points: UnknownPoints | None = None
    """values of the unknowns at which requirements are judged, for example those found by an
    earlier `run`; default: `run` searches for the worst values"""
    correlations: tuple[Correlation, ...] = ()
    """pairs of correlated parameters"""
    derived: dict[str, str] = {}
    """parameters computed from other parameters of the same flight, as expressions in SI units"""
    requirements: Annotated[
        tuple[RequirementEntry, ...],
        BeforeValidator(lambda value: value, json_schema_input_type=list[RequirementEntry] | str),
    ] = ()
    """requirements on the flights, each with a probability, or a CSV file of requirements"""
    stop: Literal["when proven"] | None = None
    """'when proven': the campaign ends as soon as every requirement has the verdict PASS or FAIL"""
    family: Family | None = None
    """joint risk that any PASS is false; default: each requirement has its own risk"""
    keep: Keep = Keep()
    """outputs to store in addition to the metrics of every flight"""
    measured: dict[str, str | float] = {}
    """standard deviation of a test flight's measurement error for each channel or metric, used
    by `abhv-mc compare` and `identify`; default: sensor noise of the campaign"""
    execution: Execution = Execution()
    """execution settings; no result depends on them"""
