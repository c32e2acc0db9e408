"""Search for narrower dispersions with which a controller passes (``abhv-mc tighten``).

The width at which new flights pass is found by bisection, because re-weighted flights are too few
to show a PASS. The answer is one grid step narrower, so that an independent sample confirms it.
"""

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.analysis.reweight import Change, make_change, weigh_flights
from abhv_mc.campaign.file.requirement_set import RequirementSource
from abhv_mc.flights.metrics import MARGIN_NAMES
from abhv_mc.flights.parameters import Parameter
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.interfaces import Engine
from abhv_mc.io.messages import InputError, check_names
from abhv_mc.io.units import unit_of
from abhv_mc.requests import SearchRequest
from abhv_mc.search.methods.evaluation import make_generator
from abhv_mc.search.search_flights import (
    binding_requirements,
    ended_early,
    not_computed,
    open_search,
)
from abhv_mc.search.space import make_space
from abhv_mc.statistics.evidence import flights_to_pass
from abhv_mc.statistics.family import judge_family
from abhv_mc.statistics.verdicts import Verdict

_STEPS = 20  # number of grid steps in the width of a dispersion
_NARROWEST = 2  # narrowest width tried, in steps; the answer is one step narrower
_TRIAL, _CONFIRMATION = 2, 3  # multiples of the campaign's flights, at each width and at the end
_BATCH = 512  # number of flights after which a width can fail


@dataclass(frozen=True)
class TightenedDispersion:
    """Share of the width of one dispersion with which the controller passes."""

    name: str
    # largest share at which re-weighted flights meet the requirements, or 0
    reweighted: float
    width: float | None = None  # None if new flights fail at the narrowest width
    entry: Mapping[str, Any] | None = None  # entry of the campaign file for this width
    verdict: Verdict | None = None  # verdict on independent flights with this width


@dataclass(frozen=True)
class Tightening:
    """Verdict on a controller, and the widths of single dispersions with which it passes."""

    controller: str
    verdict: Verdict
    # dispersions, largest re-weighted width first; empty if the controller passes
    dispersions: tuple[TightenedDispersion, ...] = ()
    folder: Path | None = None  # folder of the new flights


def tighten(
    root: Path,
    controller: str | None = None,
    names: Sequence[str] = (),
    *,
    output: Path | None = None,
    requirements: RequirementSource | None = None,
    engine: Engine | None = None,
) -> Tightening:
    """Find to which width each of the dispersions `names` must shrink so that a controller passes.

    By default, all dispersions with a width are searched. Raise InputError if there is nothing to
    judge or to narrow.
    """
    results = read_flown(root, requirements)
    campaign = results.campaign
    controller = campaign.choose_controller(controller)
    items = binding_requirements(campaign, controller)
    flights = results.flights.get(controller)
    entries = {
        name: entry
        for name, entry in campaign.dispersions.items()
        if entry.keys() & {"half_width", "sigma", "low"}
    }
    if flights is None or not (items and entries):
        problem = f"no flights or requirements of '{controller}', or no dispersion with a width"
        raise InputError(root, problem, "a campaign that has them, or --requirements FILE")
    check_names("dispersions", names, entries, "dispersion with a width")
    failed = np.array(
        [item.failures(flights.metrics[item.metric], flights.failed) for item in items]
    )
    total = flights.flight.size + flights.not_computed
    samples = np.column_stack([results.samples[name] for name in campaign.names])[flights.flight]

    def judge(failures: Any, flights: int) -> Verdict:
        """Return the least favourable of the verdicts on all requirements."""
        groups = [[item.judge(k, flights)] for item, k in zip(items, failures, strict=True)]
        verdicts = judge_family(groups, campaign.judged, campaign.family_risk)
        return min((own for own, _ in verdicts), key=lambda own: (own.status == "PASS", own.E_pass))

    def narrow_to(name: str, steps: int) -> Change:
        old = entries[name], campaign.marginals[name], campaign.parameters[name]
        return make_change(campaign, {name: narrow(*old, steps / _STEPS)})

    def meets(name: str, steps: int) -> Any:
        weights = weigh_flights(campaign, narrow_to(name, steps), samples)
        allowed = [(1.0 - item.probability) * weights.sum() for item in items]
        return (failed @ weights < allowed).all()

    verdict = judge(failed.sum(axis=1) + flights.not_computed, total)
    if verdict.status == "PASS":
        return Tightening(controller, verdict)
    shares = {name: _find_widest(1, partial(meets, name)) / _STEPS for name in names or entries}
    ranked = sorted(shares, key=lambda name: -shares[name])
    base = max(total, *(flights_to_pass(1, item.probability, item.consumer_risk) for item in items))
    folder = output or Path("reports") / "_".join((campaign.name, "tighten", controller, *names))
    with open_search(
        SearchRequest(root / "campaign.yaml", folder, controller=controller),
        {
            "kind": "tighten",
            "flights": base,
            "dispersions": ranked,
            "requirements": [f"{item.metric} {item.limits}" for item in items],
        },
        len(ranked) * base * (5 * _TRIAL + _CONFIRMATION),
        engine,
        any(item.metric in MARGIN_NAMES for item in items),
    ) as search:

        def simulate(name: str, times: int, steps: int) -> Verdict:
            """Return the verdict on new flights, which end as soon as too many have failed."""
            points = make_generator(search.seed, ranked.index(name), times).standard_normal(
                (times * base, len(search.space.names))
            )
            marginals = campaign.marginals | narrow_to(name, steps).marginals
            values = make_space(replace(campaign, marginals=marginals)).from_normal(points)
            failures, first = np.zeros(len(items), np.int64), search.flown
            for start in range(0, len(points), _BATCH):
                rows = search.fly(values[start : start + _BATCH], common_seed=False)
                early = ended_early(rows) | not_computed(rows)
                failures += [item.failures(rows.column(item.metric), early).sum() for item in items]
                if judge(failures, len(points)).status != "PASS":
                    break
            return judge(failures, search.flown - first)

        def answer(name: str) -> TightenedDispersion:
            steps = -1 + _find_widest(
                _NARROWEST, lambda steps: simulate(name, _TRIAL, steps).status == "PASS"
            )
            if not steps:
                return TightenedDispersion(name, shares[name])
            return TightenedDispersion(
                name,
                shares[name],
                steps / _STEPS,
                narrow_to(name, steps).after[name],
                simulate(name, _CONFIRMATION, steps),
            )

        answers = tuple(map(answer, ranked))
        search.finish({own.name: own.width for own in answers})
    return Tightening(controller, verdict, answers, folder)


def narrow(
    entry: Mapping[str, Any], marginal: Any, parameter: Parameter, share: float
) -> dict[str, str]:
    """Return the keys of a distribution that is narrowed about its median to a share."""
    median, keys = float(getattr(marginal, "drawn", marginal).ppf(np.array(0.5))), {}
    for key, value in entry.items():
        if key in ("half_width", "sigma"):
            unit = unit_of(value)
            keys[key] = f"{share * float(str(value).removesuffix(unit)):.6g} {unit}".strip()
        elif key in ("low", "high", "mean", "mode"):
            number = median + share * (parameter.read(value) - median)
            keys[key] = f"{number:.6g}{parameter.unit_suffix}"
    return keys


def _find_widest(narrowest: int, passes: Callable[[int], bool]) -> int:
    """Return the largest number of grid steps that passes, or `narrowest` - 1 if none does."""
    return bisect_left(range(_STEPS), True, narrowest, key=lambda steps: not passes(steps)) - 1
