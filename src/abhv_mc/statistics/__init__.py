"""Statistics: arrays in, numbers out. Nothing here reads a file or knows a controller's name."""

from abhv_mc.statistics.estimates import Interval, quantile, severity
from abhv_mc.statistics.verdicts import (
    Verdict,
    clopper_pearson,
    consumer_risk,
    judge,
    mcnemar_exact,
    producer_risk,
    quantile_upper_rank,
    runs_needed,
    success_lower_bound,
)

__all__ = [
    "Interval",
    "Verdict",
    "clopper_pearson",
    "consumer_risk",
    "judge",
    "mcnemar_exact",
    "producer_risk",
    "quantile",
    "quantile_upper_rank",
    "runs_needed",
    "severity",
    "success_lower_bound",
]
