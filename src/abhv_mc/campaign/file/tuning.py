"""The block ``tune`` of a campaign: which numbers of a controller's file are free, for what, within what."""

from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from abhv_mc.io.documents import Refusal, StrictModel

Quantile = Annotated[float, Field(gt=0.0, lt=1.0)]


class Free(StrictModel):
    """A number of the controller's file that is varied by a factor either way; in the file, its key alone will do."""

    key: str  # such as velocity.speed.bandwidth
    factor: Annotated[float, Field(gt=1.0, le=1e4)] = 3.0


class Aim(StrictModel):
    """A quantile of a metric over the flights; a flight that ended early counts as the worst."""

    metric: str
    quantile: Quantile = 0.95


class Limit(StrictModel):
    """A bound on a quantile of a metric, as a number in its unit or as so many times what the start has."""

    metric: str
    quantile: Quantile = 0.95
    below: float | None = None
    above: float | None = None
    below_start_times: Annotated[float, Field(gt=0.0)] | None = None

    @model_validator(mode="after")
    def _one(self) -> "Limit":
        given = [key for key in ("below", "above", "below_start_times") if getattr(self, key) is not None]
        if len(given) != 1:
            raise Refusal(" and ".join(given) or "none of them", "one of below, above, below_start_times")
        return self


def _free(value: Any) -> Any:
    return (
        [{"key": entry} if isinstance(entry, str) else entry for entry in value] if isinstance(value, list) else value
    )


class Tune(StrictModel):
    """What is tuned, for what, within what."""

    free: Annotated[
        tuple[Free, ...],
        Field(min_length=1),
        BeforeValidator(_free, json_schema_input_type=list[str | Free]),
    ]
    minimise: Aim
    limits: tuple[Limit, ...] = ()
    usage: Aim = Aim(metric="elevator_travel_deg", quantile=0.5)  # what the front trades the error against
    flights: Annotated[int, Field(ge=32, le=100_000)] = 64  # of each candidate, the same for all
    candidates: Annotated[int, Field(ge=17, le=100_000)] = 320
    validation: Annotated[int, Field(ge=100, le=1_000_000)] = 1000  # fresh flights for the result and the start
