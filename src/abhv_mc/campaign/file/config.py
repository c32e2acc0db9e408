"""Pydantic model of the campaign file: keys, types and checks within one entry."""

from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from abhv_mc.campaign import MOST_WORKERS
from abhv_mc.campaign.file.keep import Keep
from abhv_mc.campaign.file.tuning import Points, Tune
from abhv_mc.campaign.file.unknowns import Unknown, UnknownPoints
from abhv_mc.campaign.file.user_metrics import MetricEntry, MetricName
from abhv_mc.campaign.sampling.distributions import Distribution, Value
from abhv_mc.io.documents import File, Refusal, StrictModel
from abhv_mc.io.units import Fraction, Time

TRACED = (
    "id",
    "text",
    "source",
    "rationale",
)  # where a requirement comes from; no flight depends on it
PROCESSES, THREADS = "processes", "threads"

_LARGEST_BATCH = 2**20


def _none_for(word: str, most: int | None = None) -> Any:
    """Return a field type written as ``word`` in the file and None in the model."""
    written = Literal[word] | Annotated[int, Field(ge=1, le=most)]  # type: ignore[valid-type]

    def read(value: Any) -> Any:
        if value is None:
            raise Refusal("nothing", f"'{word}' or a whole number")
        return None if value == word else value

    return BeforeValidator(read, json_schema_input_type=written)


Workers = Annotated[
    Annotated[int, Field(ge=1, le=MOST_WORKERS)] | None, _none_for("auto", MOST_WORKERS)
]
Batch = Annotated[
    Annotated[int, Field(ge=1, le=_LARGEST_BATCH)] | None, _none_for("auto", _LARGEST_BATCH)
]
FlightCount = Annotated[Annotated[int, Field(ge=1)] | None, _none_for("all")]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=80)]
DesignName = Literal["random", "lhs", "sobol", "halton", "corners", "grid", "one_at_a_time", "file"]


class Sampling(StrictModel):
    """Sampling design; the file may give its name alone."""

    design: DesignName = Field("random", description="scheme that draws the samples")
    levels: Annotated[int, Field(ge=2, le=1000)] = Field(
        2, description="values of each parameter in a grid or one_at_a_time"
    )
    path: File | None = Field(
        None, description="for the design 'file': CSV or Parquet with one column per parameter, SI"
    )

    @model_validator(mode="after")
    def _path_for_a_file(self) -> "Sampling":
        if (self.design == "file") != (self.path is not None):
            raise Refusal(f"the design '{self.design}'", "a path for 'file', and for 'file' only")
        return self


def _sampling(value: Any) -> Any:
    return {"design": value} if isinstance(value, str) else value


class Correlation(StrictModel):
    """Correlation of two parameters' ranks (Spearman) or of their normal variables."""

    between: tuple[str, str] = Field(description="the two parameters")
    rank: Annotated[float, Field(gt=-1.0, lt=1.0)] | None = Field(
        None, description="correlation of their ranks (Spearman); either this or 'normal'"
    )
    normal: Annotated[float, Field(gt=-1.0, lt=1.0)] | None = Field(
        None, description="correlation of the normal variables of the Gaussian copula"
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> "Correlation":
        if (self.rank is None) == (self.normal is None):
            raise Refusal(
                "both" if self.rank is not None else "neither", "either 'rank' or 'normal'"
            )
        if self.between[0] == self.between[1]:
            raise Refusal(f"'{self.between[0]}' twice", "two different parameters", ("between",))
        return self


class RequirementEntry(StrictModel):
    """Requirement: the probability that a metric is below, above or between limits."""

    metric: str = Field(description="the metric that is limited")
    below: Value | None = Field(
        None, description="upper limit, which the metric must be below, in its unit"
    )
    above: Value | None = Field(
        None,
        description="lower limit, which the metric must be above, in its unit; with both "
        "limits it must lie between them",
    )
    probability: Annotated[Fraction, Field(gt=0.0, lt=1.0)] = Field(
        description="share of flights that must meet it, such as 99.73 %"
    )
    consumer_risk: Annotated[Fraction, Field(gt=0.0, lt=0.5)] = Field(
        0.10,
        description="largest chance that a system which just misses the requirement ever passes",
    )
    producer_risk: Annotated[Fraction, Field(gt=0.0, lt=0.5)] | None = Field(
        None,
        description="largest chance that a system which just meets it ever fails; default: the "
        "consumer's",
    )
    controllers: tuple[str, ...] | None = Field(
        None, description="controllers that must meet it; default: the first of the campaign"
    )
    ended_early: Literal["failure", "as_measured"] = Field(
        "failure", description="judgement of a flight that ended early: a failure, or as measured"
    )
    id: str | None = Field(
        None, description="its number where it comes from, such as GNC-12; shown everywhere"
    )
    text: str | None = Field(None, description="the requirement in words, as its source has it")
    source: str | None = Field(None, description="the document that it comes from")
    rationale: str | None = Field(None, description="why it is required")

    @model_validator(mode="after")
    def _some_limit(self) -> "RequirementEntry":
        if self.below is None and self.above is None:
            raise Refusal("neither", "'below', 'above' or both")
        return self


class MarginsOfFlights(StrictModel):
    """Flights and points of their trajectories for which stability margins are computed."""

    at: Points = Field(
        ("trim",), description="trim, or times of the flight such as 30 s, or a list of these"
    )
    flights: FlightCount = Field(
        100, description="margins are found of the first so many flights, or of all"
    )

    def of(self, runs: int) -> int:
        """Return the number of flights with margins among ``runs``."""
        return runs if self.flights is None else min(self.flights, runs)


class PooledSeed(StrictModel):
    """Seed and number of flights of one member of a pooled campaign."""

    seed: Annotated[int, Field(ge=0, lt=2**63)] = Field(description="seed of their samples")
    runs: Annotated[int, Field(ge=1)] = Field(description="number of flights, from its flight 0 on")


class Family(StrictModel):
    """Joint risk of any false PASS over all pairs of requirement and controller."""

    method: Literal["holm"] = Field("holm", description="Holm's")
    risk: Annotated[Fraction, Field(gt=0.0, lt=0.5)] = Field(
        0.10, description="largest probability that any PASS is false"
    )


class Execution(StrictModel):
    """Execution settings; no result depends on them."""

    workers: Workers = Field(
        None, description="blocks of flights flown at once; auto: one for each core"
    )
    batch: Batch = Field(None, description="flights of a block")
    isolation: Literal["auto", "processes", "threads"] = Field(
        "auto",
        description="place where flights run: in processes, one that crashes or hangs harms no "
        "other",
    )
    flight_time_limit: Annotated[Time, Field(gt=0.0)] | None = Field(
        None,
        description="processor time for every 16 flights of a block, after which they count as "
        "hanging (on a cluster wall time); default: 20 times what 16 nominal flights take one by "
        "one, margins included, and 30 s at least",
    )


class Compared(StrictModel):
    """Controllers that the campaign's question compares."""

    compare: Annotated[tuple[Name, ...], Field(min_length=2)] = Field(
        description="controllers that are compared, the campaign's first before the others"
    )


def select_asked(data: dict[str, Any], controllers: Collection[str]) -> dict[str, Any]:
    """Return a campaign's data with the question restricted to these controllers.

    The question is removed if fewer than two remain.
    """
    asks = data.get("asks")
    if not isinstance(asks, dict):
        return data
    compared = [name for name in asks["compare"] if name in controllers]
    return {**data, "asks": {"compare": compared} if len(compared) > 1 else None}


def _asks_kind(value: Any) -> str:
    return "answer" if isinstance(value, str) else "controllers"


def _metrics_kind(value: Any) -> str:
    return "file" if isinstance(value, str | Path) else "entries"


class Campaign(StrictModel):
    """A campaign file."""

    # Callable that makes the simulator of an experiment; a name, because that layer is above this
    # one.
    simulator_maker: ClassVar = "abhv_mc.vehicle_simulator.simulator:VehicleSimulator"
    name: Name = Field(description="name of the campaign, and of its folder below reports/")
    question: str = Field("", description="question of the campaign; the headline of its report")
    author: str = Field("", description="who is responsible for the campaign; opens its report")
    asks: (
        Annotated[
            Annotated[Literal["drivers", "margins", "worst"], Tag("answer")]
            | Annotated[Compared, Tag("controllers")],
            Discriminator(_asks_kind),
        ]
        | None
    ) = Field(
        None,
        description="question that the first sentence of the report answers: "
        "{compare: [controllers]}, drivers, margins or worst; default: whether the "
        "requirements are met",
    )
    vehicle: File = Field(description="vehicle file, relative to this file")
    mission: File = Field(description="mission file, relative to this file")
    controllers: Annotated[dict[Name, File], Field(min_length=1)] = Field(
        description="controller files by name; all fly the same samples, and the first has to meet "
        "the requirements"
    )
    runs: Annotated[int, Field(ge=1, le=2**30)] | None = Field(
        None, description="flights of each controller; left out where the design has its own number"
    )
    seed: Annotated[int, Field(ge=0, lt=2**63)] = Field(
        0, description="seed of all samples: the same seed, the same flights"
    )
    pooled: tuple[PooledSeed, ...] = Field(
        (),
        description="seeds that `abhv-mc merge` joined, in the order of the flights; "
        "default: one seed",
    )
    sampling: Annotated[
        Sampling, BeforeValidator(_sampling, json_schema_input_type=DesignName | Sampling)
    ] = Field(
        Sampling(),
        description="the design: its name, or a mapping with its numbers; verdicts need 'random'",
    )
    dispersions: dict[str, Distribution] = Field(
        {}, description="distributions by the parameter that they disperse"
    )
    unknowns: dict[str, Unknown] = Field(
        {},
        description="bounds of parameters with one value for the whole programme: judged at points "
        "of their box",
    )
    points: UnknownPoints | None = Field(
        None, description="points at which these are judged, as `run` found them; default: search"
    )
    correlations: tuple[Correlation, ...] = Field(
        (), description="pairs of parameters that vary together"
    )
    derived: dict[str, str] = Field(
        {},
        description="parameters that follow from others of their flight: expressions of "
        "parameters, in SI",
    )
    channels: File | None = Field(
        None, description="Python file of user channels, relative to this file"
    )
    metrics: Annotated[
        Annotated[dict[MetricName, MetricEntry], Tag("entries")] | Annotated[File, Tag("file")],
        Discriminator(_metrics_kind),
    ] = Field({}, description="user metrics by name, or a file that holds them")
    requirements: Annotated[
        tuple[RequirementEntry, ...],
        BeforeValidator(lambda value: value, json_schema_input_type=list[RequirementEntry] | str),
    ] = Field(
        (),
        description="requirements on the flights, each with a probability; or a CSV file of these",
    )
    margins: MarginsOfFlights | None = Field(
        None,
        description="stability margins of dispersed flights, as metrics; default: nominal and "
        "corners only",
    )
    stop: Literal["when proven"] | None = Field(
        None,
        description="'when proven' ends the campaign once every requirement has passed or failed",
    )
    tune: Tune | None = Field(
        None,
        description="free numbers, aim and limits of `abhv-mc tune`; no flight depends on them",
    )
    family: Family | None = Field(
        None,
        description="one risk for all verdicts together; default: each requirement has its own",
    )
    keep: Keep = Field(Keep(), description="outputs besides the metrics of every flight")
    measured: dict[str, str | float] = Field(
        {},
        description="standard deviation of the noise with which a test flight's channels are "
        "measured, by channel: for `abhv-mc place`; default: the campaign's sensors",
    )
    figures: Literal["paper"] | None = Field(
        None,
        description="'paper': the channels' figures are those of Zhu and Shen 2014, with their "
        "numbers beside them",
    )
    execution: Execution = Field(
        Execution(), description="execution settings; no result depends on them"
    )
