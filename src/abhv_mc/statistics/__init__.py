"""Statistical functions that operate on arrays only, without files or controllers."""

from abhv_mc.statistics.binomial import (
    clopper_pearson,
    consumer_risk,
    mcnemar_exact,
    quantile_upper_rank,
    runs_needed,
    success_lower_bound,
)
from abhv_mc.statistics.estimates import Interval, quantile, severity
from abhv_mc.statistics.verdicts import Verdict, judge

__all__ = [
    "Interval",
    "Verdict",
    "clopper_pearson",
    "consumer_risk",
    "judge",
    "mcnemar_exact",
    "quantile",
    "quantile_upper_rank",
    "runs_needed",
    "severity",
    "success_lower_bound",
]
