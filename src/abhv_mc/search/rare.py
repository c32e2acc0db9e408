"""Probability that a flight violates a requirement (``abhv-mc rare``)."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment, Requirement
from abhv_mc.campaign.sampling.marginals import find_atoms
from abhv_mc.flights.metrics import Metric
from abhv_mc.flights.parameters import Parameters
from abhv_mc.folder.flights import FlightRows
from abhv_mc.interfaces import Engine
from abhv_mc.io.messages import InputError, counted, grouped_digits, notify, one_of, quoted
from abhv_mc.process_settings import one_blas_thread
from abhv_mc.requests import RareRequest
from abhv_mc.search.methods.evaluation import LANES, make_generator
from abhv_mc.search.methods.rare import (
    CONFIDENCE,
    FEWEST,
    RareEstimate,
    choose_chains,
    noise_share,
)
from abhv_mc.search.methods.second_opinion import MOST_LOOKED, MOST_SAMPLED
from abhv_mc.search.methods.strata import Stratum, Switched, estimate_switched
from abhv_mc.search.methods.subset import SubsetPlan
from abhv_mc.search.methods.surrogate import (
    FEWEST_RUNS,
    MOST_DIMENSIONS,
    SurrogateEstimate,
    estimate_by_surrogate,
)
from abhv_mc.search.search_flights import (
    FAILS_ABOVE,
    DrawnFlights,
    Severity,
    binding_requirements,
    ended_early,
    open_search,
    rank_distinct,
    read_searched,
)
from abhv_mc.search.space import Space, make_space
from abhv_mc.statistics.estimates import Criterion

_PILOT = 2 * LANES  # number of points that are simulated twice to measure the noise
_PLACE = 1 << 22  # key of the random numbers for the points at which the noise is measured
_UNLIKELY = 0.5  # noise share above which probabilities below 1e-4 can hardly be estimated


@dataclass(frozen=True)
class RareFound:
    """Rare-event estimate, with the search flights."""

    request: RareRequest
    controller: str
    requirement: Requirement
    metric: Metric
    estimate: RareEstimate
    # combinations of parameters that occur in some flights only; empty without such parameters
    strata: tuple[Stratum, ...]
    space: Space
    flights: FlightRows = field(repr=False)
    # excess over the limit, in the metric's unit [flight]
    severities: Floats = field(repr=False)
    failed_to_run: int
    drawn: DrawnFlights | None = field(repr=False)
    known: Parameters
    # share of the variance of the severity ranks that is due to noise; None without noise
    noise_share: float | None
    includes_unwarned: bool  # whether the interval includes failures without warning

    def words(self, stratum: Stratum) -> str:
        """Return the names of the active switches of a combination."""
        switches = list(self.space.probabilities)
        return (
            "all others"
            if stratum.on is None
            else quoted(switches[i] for i in stratum.on)
            if stratum.on
            else "none of them"
        )

    @property
    def unwarned(self) -> str:
        """Bound on the probability of failures without warning, and its use, as text."""
        high, (_, flights) = self.estimate.unwarned_high, self.estimate.plain
        if high is None:
            return ""
        bound = f"below {high:.1e} ({grouped_digits(flights)} plain flights)"
        if self.includes_unwarned:
            source = "this bound" if self.estimate.high <= high else "the levels"
            return f"{bound}, included; upper end of the interval from {source}"
        if self.estimate.check is not None and len(self.space.names) <= MOST_LOOKED:
            return ""
        return f"{bound}, not included"

    @property
    def second_opinion(self) -> str:
        """Result of a second method, as text."""
        check = self.estimate.check
        if isinstance(self.estimate, SurrogateEstimate):
            rough, smooth = self.estimate.steps[-1].probabilities
            return f"{rough:.1e} (Matern kernel), {smooth:.1e} (infinitely smooth kernel)"
        if check is None:
            return f"none (needs unused flights and at most {MOST_SAMPLED} dispersions)"
        count = f"{check.effective:.0f} effective failures"
        return f"{check.probability:.1e} by importance sampling ({count})"

    @property
    def failures(self) -> int:
        """Number of flights that fail."""
        return int((self.severities > FAILS_ABOVE).sum())

    def numbers(self) -> dict[str, Any]:
        """Return the result as JSON values."""
        estimate = self.estimate
        refused = estimate.refusal is not None
        check = estimate.check
        return {
            "requirement": self.request.requirement,
            **self.requirement.limits.as_entry(),
            "controller": self.controller,
            "probability": None if refused else estimate.probability,
            "low": None if refused else estimate.low,
            "high": None if refused else estimate.high,
            "confidence": CONFIDENCE,
            "unwarned_high": estimate.unwarned_high,
            "includes_unwarned": self.includes_unwarned,
            "noise_share": self.noise_share,
            "flights": estimate.flights,
            "cov": None if refused else estimate.cov,
            "levels": [
                {
                    "repetition": repetition.number,
                    "limit": level.threshold,
                    "probability": level.probability,
                    "cov": level.cov,
                    "acceptance": level.acceptance,
                }
                for repetition in estimate.repetitions
                for level in repetition.levels
            ],
            "repetitions": [repetition.probability for repetition in estimate.repetitions],
            "combinations": [
                {**vars(stratum), "on": self.words(stratum)} for stratum in self.strata
            ],
            "importance_sampling": None
            if check is None
            else {**vars(check), "cov": check.cov if np.isfinite(check.cov) else None},
            "surrogate": [vars(step) for step in estimate.steps]
            if isinstance(estimate, SurrogateEstimate)
            else None,
            "refusal": estimate.refusal,
            "ended_early": int(ended_early(self.flights).sum()),
            "ended_early_fails": self.requirement.early_is_failure,
            "failed_to_run": self.failed_to_run,
            "failures": self.failures,
            "worst_flights": rank_distinct(self.severities, self.flights.samples, 20),
        }


def find_rare(request: RareRequest, engine: Engine | None = None) -> RareFound:
    """Estimate the probability that a flight violates one requirement.

    Raise InputError if the request is invalid.
    """
    campaign, controller = read_searched(request.campaign, request.controller, request.seed)
    requirement = find_requirement(campaign, controller, request.requirement)
    space = make_space(campaign)
    flights = request.most_flights
    chains = choose_chains(flights)
    is_noisy = bool(space.seeds) or campaign.simulator.states_noise
    least = FEWEST * SubsetPlan(1, 0.0, 0, chains).size + 2 * _PILOT * is_noisy
    if request.surrogate:
        _check_smooth(space, is_noisy)
        least = FEWEST_RUNS
    if flights < least:
        raise InputError("--flights", f"found {flights}", f"at least {least}")
    criterion = Criterion(requirement.metric, "high", requirement.limits)
    early = requirement.early_is_failure
    with open_search(request, {"kind": "rare", **request.settings}, flights, engine) as search:
        severity = Severity(criterion, search.duration, early)

        def evaluate(points: Floats, on: Switched) -> Floats:
            # A flight that failed to run counts as a failure, as in every verdict.
            values = severity.of(search.fly(space.from_normal(points, on), common_seed=False))
            return np.where(np.isnan(values), np.inf, values)

        plan = SubsetPlan(len(space.names), FAILS_ABOVE, search.seed, chains)
        switches = np.array(list(space.probabilities.values()))
        noise = None
        if is_noisy:
            generator = make_generator(search.seed, _PLACE)
            points = generator.standard_normal((_PILOT, len(space.names)))
            off = np.zeros((_PILOT, len(switches)), dtype=bool)
            noise = noise_share((evaluate(points, off), evaluate(points, off)))
            if noise > _UNLIKELY:
                notify(
                    f"warning: {100.0 * noise:.0f} % of the variance of the severity ranks is "
                    f"noise ({_PILOT} points were simulated with two seeds each); a probability "
                    "below 1e-4 can hardly be estimated"
                )
        target_cov = float(request.target_cov)
        estimate: RareEstimate
        if request.surrogate:
            strata: tuple[Stratum, ...] = ()
            # With one thread, a resumed search gives bit-identical results.
            with one_blas_thread():
                estimate = estimate_by_surrogate(
                    lambda points: evaluate(points, np.zeros((len(points), 0), bool)),
                    plan,
                    target_cov,
                    flights,
                )
        else:
            estimate, strata = estimate_switched(
                evaluate, switches, plan, target_cov, flights - search.flown
            )
        rows = search.rows()
        ended = early and bool(ended_early(rows).any())
        unwarned = not request.surrogate and (noise is not None or ended)
        if unwarned:
            estimate = estimate.include_unwarned()
        severities = severity.ranked(rows)
        result = RareFound(
            request=request,
            controller=controller,
            requirement=requirement,
            metric=campaign.metrics[requirement.metric],
            estimate=estimate,
            strata=strata,
            space=space,
            flights=rows,
            severities=severities,
            failed_to_run=search.failed_to_run,
            drawn=search.draw(severities),
            known=campaign.parameters,
            noise_share=noise,
            includes_unwarned=unwarned,
        )
        search.finish(result.numbers())
    return result


def _check_smooth(space: Space, is_noisy: bool) -> None:
    """Raise InputError unless the severity can be a smooth function of few parameters."""
    atoms = [
        name
        for name, marginal in zip(space.names, space.marginals, strict=True)
        if find_atoms(marginal).size
    ]
    if is_noisy:
        problem = "the flights depend on turbulence, noise or other random seeds"
        remedy = "a campaign without random seeds, or `rare` without --surrogate"
    elif atoms:
        problem = f"'{atoms[0]}' has discrete values"
        remedy = "continuous distributions, or `rare` without --surrogate"
    elif len(space.names) > MOST_DIMENSIONS:
        problem = f"the campaign has {counted(len(space.names), 'dispersion')}"
        remedy = f"at most {MOST_DIMENSIONS}, or `rare` without --surrogate"
    else:
        return
    raise InputError("--surrogate", problem, remedy)


def find_requirement(campaign: Experiment, controller: str, name: str) -> Requirement:
    """Return the requirement that has the ID or the metric `name`.

    Raise InputError if there is not exactly one such requirement, or if the metric has plateaus.
    """
    bound = binding_requirements(campaign, controller)
    own = [item for item in bound if item.traced.get("id") == name]
    own = own or [item for item in bound if item.metric == name]
    metric = own[0].metric if own else name
    where = ("requirements",)
    if (metric_record := campaign.metrics.get(metric)) and metric_record.plateaus:
        values = " or ".join(f"{value:g}" for value in metric_record.plateaus)
        raise campaign.document.error(
            where if own else (),
            f"the metric '{metric}' can be {values} in many flights",
            "a metric that differs between flights; if it is constant, no flight is closer to "
            "failure than another",
        )
    if len(own) == 1:
        return own[0]
    if not own:
        names = [item.metric for item in bound]
        problem = f"the controller '{controller}' has no requirement on '{metric}'"
        expected = one_of(names, metric) if names else "a requirement with this limit"
        raise campaign.document.error(where if names else (), problem, expected)
    raise campaign.document.error(
        where,
        f"there are {len(own)} requirements on '{metric}'",
        "the 'id' of one of these requirements",
    )
