"""Block ``tune`` of a campaign: free parameters of a controller, objective and limits."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from abhv_mc.flights.metrics import MARGIN_NAMES
from abhv_mc.io.documents import StrictModel
from abhv_mc.io.messages import Refusal, quoted
from abhv_mc.io.units import TIME, Fraction, parse_quantity
from abhv_mc.statistics.quantile_pairs import flights_to_bound
from abhv_mc_vehicle.flight.metrics import ELEVATOR_TRAVEL

Quantile = Annotated[Fraction, Field(gt=0.0, lt=1.0)]
_METRIC = Field(description="name of the metric")
_QUANTILE = Field(0.95, description="quantile of the metric over the flights")


class Free(StrictModel):
    """Parameter in the controller file that tuning multiplies or divides by a factor.

    In the campaign file, the value of ``key`` alone may replace the mapping.
    """

    key: str
    """key in the controller file, such as velocity.speed.bandwidth"""
    factor: Annotated[float, Field(gt=1.0, le=1e4)] = 5.0
    """largest factor by which tuning may multiply or divide the parameter"""


class Aim(StrictModel):
    """Objective: quantile of a metric; early terminations count as the worst value."""

    metric: str = _METRIC
    quantile: Quantile = _QUANTILE


class Limit(StrictModel):
    """Bound on a quantile of a metric, absolute or relative to the initial controller.

    For a stability margin, the limit applies to the smallest margin of the nominal vehicle, or of
    the nominal vehicle and all corners of the dispersions.
    """

    metric: str = _METRIC
    quantile: Quantile = _QUANTILE
    below: float | None = None
    """upper limit, in the metric's unit"""
    above: float | None = None
    """lower limit, in the metric's unit"""
    below_start_times: Annotated[float, Field(gt=0.0)] | None = None
    """upper limit, as a multiple of the value that the initial controller attains"""
    vehicles: Literal["nominal", "corners"] | None = None
    """vehicles whose stability margin must meet the limit: only the nominal vehicle (default),
    or also the vehicles at all corners of the dispersions"""

    @property
    def is_margin(self) -> bool:
        """Return True if ``metric`` is a stability margin, False if it is a metric of flights."""
        return self.metric in MARGIN_NAMES

    @model_validator(mode="after")
    def _one(self) -> "Limit":
        bounds = [
            key for key in ("below", "above", "below_start_times") if getattr(self, key) is not None
        ]
        if len(bounds) != 1:
            raise Refusal(
                f"found the limits {quoted(bounds)}" if bounds else "no limit is set",
                "exactly one of the keys 'below', 'above' and 'below_start_times'",
            )
        if self.is_margin and (
            "quantile" in self.model_fields_set or self.above is None or self.above <= 0.0
        ):
            raise Refusal(
                f"the limit on the stability margin '{self.metric}' is invalid",
                "the key 'above' with a positive number, and no quantile",
            )
        if self.vehicles is not None and not self.is_margin:
            raise Refusal(
                f"'vehicles' does not apply to '{self.metric}'",
                "no such key, because it applies only to limits on stability margins",
            )
        return self


def _points(value: Any) -> Any:
    entries = value if isinstance(value, list) else [value]
    if not entries:
        raise Refusal("the list of points is empty", "'trim', or times of the flight such as 30 s")
    return ["trim" if entry == "trim" else parse_quantity(entry, TIME) for entry in entries]


Points = Annotated[
    tuple[Literal["trim"] | float, ...],
    BeforeValidator(_points, json_schema_input_type=str | list[str]),
]


class Tune(StrictModel):
    """Tuning problem: free parameters, objective and limits."""

    free: Annotated[
        tuple[Free, ...],
        Field(min_length=1),
        BeforeValidator(
            lambda value: (
                [{"key": entry} if isinstance(entry, str) else entry for entry in value]
                if isinstance(value, list)
                else value
            ),
            json_schema_input_type=list[str | Free],
        ),
    ]
    """parameters to vary"""
    minimise: Aim
    """quantity to minimise"""
    limits: tuple[Limit, ...] = ()
    """limits that the tuned controller must meet"""
    margins_at: Points = ("trim",)
    """points at which stability margins are computed: 'trim', or times of the flight such as 30
    s"""
    usage: Aim = Aim(metric=ELEVATOR_TRAVEL, quantile=0.5)
    """second objective; it forms a Pareto front with the objective of 'minimise'"""
    flights: Annotated[int, Field(ge=32, le=100_000)] = 64
    """number of flights for each candidate; all candidates have the same samples"""
    candidates: Annotated[int, Field(ge=17, le=100_000)] = 320
    """number of parameter sets to evaluate"""
    validation: Annotated[int, Field(ge=100, le=1_000_000)] = 1000
    """number of new flights for validating the tuned and initial controllers"""

    @model_validator(mode="after")
    def _bounded(self) -> "Tune":
        quantile = self.minimise.quantile
        least = flights_to_bound(quantile)
        if self.validation < least:
            problem = (
                f"'validation: {self.validation}' is too small for the {100.0 * quantile:g} % "
                "quantile"
            )
            key = "validation" if "validation" in self.model_fields_set else "minimise"
            raise Refusal(
                problem,
                f"'validation: {least}' or more, to bound the difference between the quantiles",
                (key,),
            )
        return self
