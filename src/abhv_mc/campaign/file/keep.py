"""Settings under ``keep``: the flights and rates of the stored time histories."""

import re
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

from abhv_mc.io.documents import Refusal, StrictModel, found_value
from abhv_mc.io.units import Frequency

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
            where = (i,) if len(value) > 1 else ()
            raise Refusal(
                found_value(item),
                "'all', 'none', 'failed', 'worst 20', 'every 100' or a flight number",
                where,
            )
    return value


class KeepHistories(StrictModel):
    """Flights whose histories are stored: the union of the entries of ``flights``."""

    flights: Annotated[
        tuple[int | str, ...],
        AfterValidator(_flights),
        BeforeValidator(as_list, json_schema_input_type=int | str | list[int | str]),
    ] = Field(
        ("worst 20",),
        description=(
            "'all', 'none', 'failed', 'worst 20', 'every 100', a flight number, or a list of these"
        ),
    )
    by: str = Field(
        BY_REQUIREMENTS,
        description=(
            "criterion for 'worst': requirements (the largest exceedance of a limit, relative to "
            "the limit) or a metric; early terminations come first"
        ),
    )
    rate: Rate = Field(10.0, description="samples per second of flight")


class KeepEnvelopes(StrictModel):
    """Time-history envelopes over all flights."""

    rate: Rate = Field(5.0, description="time bins per second of flight")


class Keep(StrictModel):
    """Outputs that a campaign stores in addition to metrics."""

    histories: KeepHistories = Field(
        KeepHistories(), description="flights whose full time histories are stored"
    )
    envelopes: KeepEnvelopes = Field(
        KeepEnvelopes(), description="time-history envelopes over all flights"
    )
