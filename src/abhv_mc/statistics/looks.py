"""What a verdict is worth after several looks: exact at the first, none for flights that were added because of it.

Extending a campaign until it passes would give each extension its own chance of a false PASS. So what the first look
at all planned flights settled stays settled, with the flights of then, and nothing else is settled any more.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from abhv_mc.statistics.sequential import (
    SequentialPlan,
    at_least_as_bad,
    at_least_as_good,
    sequential_lower_bound,
    sequential_verdict,
)
from abhv_mc.statistics.verdicts import Verdict, judge, posterior_met

Flags = NDArray[np.bool_]


def judge_at_looks(
    missed: Flags,
    uncomputed: Flags,
    looks: Sequence[int],
    probability: float,
    risk: float = 0.1,
    independent: bool = True,
) -> Verdict:
    """The verdict of a campaign of fixed size on flights [flight] in flight order.

    `missed` are the failures, `uncomputed` the flights that the machine could not compute, which count as failures.
    `looks` are the numbers of flights at which all that was planned was there, ascending; flights beyond the last
    settle nothing. That a flight is computed after all changes the verdict of the look that it belongs to.
    """
    if missed.shape != uncomputed.shape:
        raise ValueError(f"{missed.size} flights that are judged and {uncomputed.size} that are computed or not")
    if any(later < earlier for earlier, later in pairwise(looks)) or (looks and looks[0] < 1):
        raise ValueError(f"looks must ascend from 1, found {list(looks)}")

    def judge_first(flights: int) -> Verdict:
        absent = uncomputed[:flights]
        failures = int(np.sum(missed[:flights] & ~absent))
        return judge(failures, absent.size, probability, risk, independent, int(absent.sum()))

    if not looks or looks[0] > missed.size:
        note = f"{missed.size} flights are not all that were planned"
        return _estimate(judge_first(missed.size), note)
    return extended(judge_first(looks[0]), judge_first(missed.size))


def extended(first: Verdict, now: Verdict) -> Verdict:
    """The verdict that holds `now` when the `first` look settled what it says, whatever flights came later."""
    if now.runs == first.runs or first.status == "ESTIMATE":
        return now
    if first.status in ("PASS", "FAIL"):
        return replace(first, note=f"settled by the first {first.runs} flights; what was added settles nothing")
    note = (
        f"the campaign was extended from {first.runs} to {now.runs} flights after a look that did not settle it, "
        "so no exact verdict is left"
    )
    return _estimate(now, note)


def _estimate(verdict: Verdict, note: str) -> Verdict:
    """An estimate has counts, but no bound, risk or posterior that it could promise."""
    return replace(
        verdict,
        status="ESTIMATE",
        lower_bound=None,
        consumer_risk=None,
        producer_risk=None,
        provisional=False,
        met=None,
        note=note,
    )


def judge_by_plan(missed: Flags, uncomputed: Flags, plan: SequentialPlan, untried: Flags | None = None) -> Verdict:
    """The verdict of a campaign that stops when proven, with bounds and risks that allow for the looks.

    Flights [flight] as in `judge_at_looks`. Of the uncomputed ones, `untried` have not been flown a second time: no
    look that they belong to settles anything.
    """
    known = missed.size if untried is None else first_untried(untried)
    failed = (missed | uncomputed)[:known]
    found = sequential_verdict(failed, plan)
    healed = sequential_verdict(failed & ~uncomputed[:known], plan)
    settled = found.status in ("PASS", "FAIL")
    absent = int(uncomputed[: found.flights].sum())
    return Verdict(
        found.status,
        found.failures,
        found.flights,
        plan.probability,
        plan.risk,
        sequential_lower_bound(found, plan) if found.flights else 0.0,
        at_least_as_good(found, plan, plan.probability),
        at_least_as_bad(found, plan, plan.probability),
        0 if found.status == "PASS" else None,
        absent,
        healed.status != found.status,
        posterior_met(found.failures, found.flights, plan.probability),
        f"settled at the look after {found.flights} flights" if settled else "",
    )


def first_untried(untried: Flags) -> int:
    """Number of flights before the first that was not computed and not tried again: looks up to it may settle."""
    return int(np.argmax(untried)) if untried.any() else untried.size
