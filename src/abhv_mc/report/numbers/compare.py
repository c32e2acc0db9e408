"""Paired comparison of two campaigns with the same samples and common points of the unknowns."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats, Indices, Ints
from abhv_mc.campaign.file.experiment import Experiment, Requirement
from abhv_mc.campaign.file.unknowns import Unknowns
from abhv_mc.folder.controller_flights import ControllerFlights, common_rows, distances
from abhv_mc.folder.flown_campaign import FlownCampaign, read_flown
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.messages import InputError, check_names, counted, grouped_digits, quoted
from abhv_mc.io.units import parse_in_unit
from abhv_mc.requests import parse_pairs
from abhv_mc.statistics.gate import RISK, Gate, judge_change
from abhv_mc.statistics.winner import PairedFailures
from abhv_mc.topics.comparison.model import ControllerPair, compare_any_failures, compare_pair
from abhv_mc.topics.formatting import percent, significant
from abhv_mc.topics.missed_requirements import requirement_failures, requirement_words

_SAME = 1e-9  # relative tolerance within which points count as equal


@dataclass(frozen=True, kw_only=True)
class CampaignPair(ControllerPair):
    """Comparison of a controller in one campaign with a controller in another campaign."""

    controllers: tuple[str, str]
    any_failure: PairedFailures  # failures due to a violated requirement or early termination
    newly_lost: int  # flights that terminated early or failed to run only in campaign b
    # non-inferiority tests by metric, at the worst point of the unknown parameters
    not_worse: Mapping[str, Gate]


@dataclass(frozen=True)
class Compared:
    """Comparison of two campaigns flight by flight."""

    requirements: tuple[str, ...]  # requirements as text, in the order of the counts in ``pairs``
    words: Mapping[str, Mapping[str, str]]  # printed names and unit of each metric
    paired: tuple[CampaignPair, ...]


@dataclass(frozen=True, kw_only=True)
class Baseline(Compared):
    """Comparison of a campaign with an earlier one."""

    folder: str
    digest: str | None


def require_same_samples(
    samples_a: Mapping[str, Floats], samples_b: Mapping[str, Floats], folder: Path, path: Path
) -> None:
    """Raise InputError if the samples in two campaign folders differ.

    ``samples_a`` belongs to ``folder`` and ``samples_b`` to ``path``; the message names both.
    """
    expected = f"the samples of {folder}"
    for name in {**samples_a, **samples_b}:
        if name not in samples_b or name not in samples_a:
            kind = "additional" if name in samples_b else "no"
            raise InputError(path, f"the samples have {kind} column '{name}'", expected)
    for name, values in samples_a.items():
        values_b = samples_b[name]
        count = min(values.size, values_b.size)
        differ = np.flatnonzero(values[:count] != values_b[:count])
        if differ.size:
            k = int(differ[0])
            problem = f"'{name}' is {float(values_b[k])!r} in flight {k}"
            raise InputError(path, problem, f"{float(values[k])!r}, as in '{folder}'")


def check_baseline(campaign: Experiment, baseline: Path) -> None:
    """Raise InputError if a planned campaign cannot be paired with the baseline."""
    results = read_flown(baseline)
    source, unknowns = campaign.make_samples(), results.campaign.unknowns
    if unknowns.names != campaign.unknowns.names:
        raise campaign.document.key_error(
            ("unknowns",),
            "the unknowns differ from those of the baseline",
            f"{quoted(unknowns.names)}, as in '{baseline}'",
        )
    rows = source.draw(0, campaign.runs)[:: len(campaign.unknowns.points)]
    columns = {
        name: rows[:, i] for i, name in enumerate(source.names) if name not in unknowns.names
    }
    expected_samples = {
        name: values[:: len(unknowns.points)] for name, values in _drawn(results).items()
    }
    require_same_samples(expected_samples, columns, baseline, campaign.document.path)
    if not set(campaign.controllers) & set(results.flights):
        raise campaign.document.error(
            ("controllers",),
            "none of the controllers is in the baseline",
            f"{quoted(results.controllers, 'or')}, as in {baseline}",
        )


def _drawn(results: FlownCampaign) -> dict[str, Floats]:
    """Return the samples of the dispersions, without the values of unknowns."""
    unknowns = results.campaign.unknowns.names
    return {name: values for name, values in results.samples.items() if name not in unknowns}


def parse_margins(texts: Sequence[str]) -> dict[str, float]:
    """Parse texts such as ``METRIC=5%`` into shares. Raise InputError for an invalid text."""

    def parse(text: str) -> float:
        if (margin := parse_in_unit(text, "-")) < 0.0:
            raise ValueError(text)
        return margin

    return parse_pairs("--fail-if-worse", texts, "METRIC=SHARE with a share such as 5%", parse)


def pair_campaigns(a: FlownCampaign, b: FlownCampaign) -> tuple[FlownCampaign, FlownCampaign]:
    """Return two campaigns restricted to flights at their common points of the unknowns.

    Sample k at common point p is flight ``k * points + p`` in both campaigns. Raise InputError if
    the unknowns or the samples differ, or if there is no common point.
    """
    unknowns_a, unknowns_b = a.campaign.unknowns, b.campaign.unknowns
    if unknowns_a.names != unknowns_b.names:
        raise InputError(
            b.folder,
            f"the unknowns are {quoted(unknowns_b.names)}"
            if unknowns_b.names
            else "the campaign has no unknowns",
            f"{quoted(unknowns_a.names)}, as in {a.folder}",
        )
    pairs = np.array(
        [
            (i, j)
            for i, point_a in enumerate(unknowns_a.points)
            for j, point_b in enumerate(unknowns_b.points)
            if np.allclose(point_a, point_b, rtol=_SAME, atol=0.0)
        ]
    ).reshape(-1, 2)
    if not len(pairs):
        raise InputError(
            b.folder,
            "the campaigns have no common point of the unknowns",
            f"at least one of the points of {a.folder}",
        )
    a, b = _restrict(a, pairs[:, 0]), _restrict(b, pairs[:, 1])
    require_same_samples(_drawn(a), _drawn(b), a.folder, CampaignFolder(b.folder).samples)
    return a, b


def _restrict(results: FlownCampaign, points: Indices) -> FlownCampaign:
    """Return the results with only the flights at the given points, in the given order."""
    total = len(results.campaign.unknowns.points)
    if np.array_equal(points, np.arange(total)):
        return results
    order = np.full(total, -1)
    order[points] = np.arange(len(points))

    def renumber(numbers: Ints) -> tuple[Ints, Indices]:
        """Return new flight numbers in ascending order, and the row of each number."""
        position = order[numbers % total]
        rows = np.flatnonzero(position >= 0)
        new = (numbers // total * len(points) + position)[rows]
        return np.sort(new), rows[np.argsort(new)]

    flights = {}
    for name, controller_flights in results.flights.items():
        number, rows = renumber(controller_flights.flight)
        flights[name] = replace(
            controller_flights,
            flight=number,
            outcome=controller_flights.outcome[rows],
            metrics={metric: values[rows] for metric, values in controller_flights.metrics.items()},
            absent=renumber(controller_flights.absent)[0],
        )
    unknowns = replace(
        results.campaign.unknowns,
        points=results.campaign.unknowns.points[points],
        shared=None,
        most_failures=(),
    )
    runs = results.campaign.runs // total * len(points)
    samples = {
        name: values[: values.size // total * total].reshape(-1, total)[:, points].ravel()
        for name, values in results.samples.items()
    }
    campaign = replace(results.campaign, unknowns=unknowns, runs=runs)
    return replace(results, campaign=campaign, samples=samples, flights=flights)


def compare_results(
    a: FlownCampaign,
    b: FlownCampaign,
    controllers: Sequence[str] = (),
    margins: Mapping[str, float] | None = None,
) -> Compared:
    """Compare the controllers of two campaigns on the same samples.

    The requirements and metrics of `a` are used. By default, controllers with the same name are
    compared; `controllers` selects one controller of `a` and one of `b` instead. If the numbers of
    flights differ, the common flights are compared. For each metric in `margins`, `b` may be worse
    than `a` by the given share. Raise InputError if the campaigns have nothing in common.
    """
    metrics = [name for name in a.metrics if name in b.metrics]
    compared = [name for name in a.compared if name in metrics]
    records = a.campaign.metrics
    check_names("--fail-if-worse", margins or (), metrics, "metric")
    requirements = tuple(item for item in a.campaign.requirements if item.metric in metrics)
    independent, unknowns = a.campaign.judged, a.campaign.unknowns
    pairs = []
    for name_a, name_b in pair_controllers(a, b, controllers):
        flights = select_flights(a, b, name_a, name_b)
        names = (f"{a.folder}: {name_a}", f"{b.folder}: {name_b}")
        pair = compare_pair(
            *flights,
            names,
            metrics,
            compared,
            requirements=requirements,
            independent=independent,
            points=len(unknowns.points),
        )
        if pair is not None:
            gates = {
                metric: _gate(*flights, metric, margin, requirements, unknowns=unknowns)
                for metric, margin in (margins or {}).items()
            }
            rows_a, rows_b = common_rows(*flights)
            newly_lost = flights[1].failed[rows_b] & ~flights[0].failed[rows_a]
            pairs.append(
                CampaignPair(
                    **vars(pair),
                    controllers=(name_a, name_b),
                    any_failure=compare_any_failures(*flights, requirements),
                    newly_lost=newly_lost.sum(),
                    not_worse=gates,
                )
            )
    if not pairs:
        raise InputError(
            b.folder, "the campaigns have no flight in common", f"flight numbers of {a.folder}"
        )
    requirement_texts = tuple(requirement_words(item, records) for item in requirements)
    return Compared(
        requirement_texts, {name: records[name].as_texts() for name in metrics}, tuple(pairs)
    )


def select_flights(
    a: FlownCampaign, b: FlownCampaign, controller_a: str, controller_b: str
) -> tuple[ControllerFlights, ControllerFlights]:
    """Return the flights of one controller in each campaign, and the metric records of `a`."""
    return a.flights[controller_a], replace(b.flights[controller_b], records=a.campaign.metrics)


def compare_baseline(results: FlownCampaign, baseline: Path) -> Baseline:
    """Compare a campaign with an earlier one on the same samples.

    Raise InputError if the samples differ.
    """
    earlier = read_flown(baseline)
    before, after = pair_campaigns(earlier, results)
    comparison = compare_results(after, before)
    earlier.refuse_changes()
    return Baseline(**vars(comparison), folder=baseline.as_posix(), digest=earlier.manifest.digest)


def gate_text(pair: CampaignPair, metric: str, requirements: Sequence[str]) -> str:
    """Return the result of the non-inferiority test of a metric, with its counts and reasons."""
    gate, worst = pair.not_worse[metric], pair.metrics[metric].worst
    texts = [
        "passed" if gate.shown else "not passed",
        f"within {100.0 * gate.margin:g} % on {grouped_digits(gate.within)} of "
        f"{grouped_digits(gate.pairs)} flights (at least {percent(gate.within_low, 2)} of all, "
        "required: over 50 %)",
    ]
    texts += [f"unknowns {gate.at}"] if gate.at else []
    texts += [f"worse {100.0 * level:.4g} % quantile" for level in gate.worse_tails]
    texts += [f"worst flight {' -> '.join(map(significant, worst))}"] if gate.worst_doubled else []
    texts += ["more early terminations"] if gate.loses_more else []
    texts += [f"more violations of {requirements[k]}" for k in gate.misses_more]
    return "; ".join(texts)


def _gate(
    a: ControllerFlights,
    b: ControllerFlights,
    metric: str,
    margin: float,
    requirements: Sequence[Requirement],
    *,
    unknowns: Unknowns,
) -> Gate:
    """Return the non-inferiority test of `b` against `a` at the worst point of the unknowns.

    The worst point is the point at which `b` is rejected or comes closest to rejection. The test
    that accepts `b` needs no correction for the number of points, because `b` must be accepted at
    every point. Each kind of test that may reject `b` has the same risk.
    """
    rows_a, rows_b = common_rows(a, b)
    values = distances(a, metric, rows_a), distances(b, metric, rows_b)
    lost = a.failed[rows_a], b.failed[rows_b]
    missed = [
        (requirement_failures(a, item)[rows_a], requirement_failures(b, item)[rows_b])
        for item in requirements
    ]
    points, gates = len(unknowns.points), []
    for point in range(points):
        mask = a.flight[rows_a] % points == point
        gate = judge_change(
            values[0][mask],
            values[1][mask],
            (lost[0][mask], lost[1][mask]),
            [(x[mask], y[mask]) for x, y in missed],
            margin,
            risk=RISK / points,
        )
        gates.append(replace(gate, at=unknowns.words(point) if unknowns.names else ""))
    return min(gates, key=lambda gate: (gate.shown, gate.within_low))


def pair_controllers(
    a: FlownCampaign, b: FlownCampaign, controllers: Sequence[str]
) -> Iterator[tuple[str, str]]:
    """Yield the pairs of controllers to compare: the named pair, or all common controllers."""
    if controllers:
        if len(controllers) != 2:
            problem = f"found {counted(len(controllers), 'controller')}"
            raise InputError("--controllers", problem, "two names, one from each folder")
        for name, results in zip(controllers, (a, b), strict=True):
            if name not in results.flights:
                expected = quoted(results.controllers, "or")
                raise InputError(results.folder, f"the folder has no flights of '{name}'", expected)
        yield controllers[0], controllers[1]
        return
    common = [name for name in a.controllers if name in b.flights]
    if not common:
        problem = f"the folder has only flights of {quoted(b.controllers)}"
        raise InputError(b.folder, problem, f"flights of {quoted(a.controllers, 'or')}")
    yield from ((name, name) for name in common)
