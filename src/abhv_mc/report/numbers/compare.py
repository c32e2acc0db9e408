"""Two campaigns flown on the same samples, compared flight by flight."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment, Requirement
from abhv_mc.campaign.file.unknowns import Unknowns
from abhv_mc.folder.controller_flights import ControllerFlights, common_rows, distances
from abhv_mc.folder.flown_campaign import FlownCampaign, read_flown
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.documents import InputError, Refusal, one_of
from abhv_mc.io.units import parse_in_unit
from abhv_mc.report.numbers.common_points import at_common_points
from abhv_mc.statistics.gate import RISK, Gate, judge_change
from abhv_mc.statistics.paired import PairedFailures
from abhv_mc.topics.comparison.model import ControllerPair, compare_any_failures, compare_pair
from abhv_mc.topics.missed_requirements import requirement_failures, requirement_words
from abhv_mc.topics.words import percent, significant


@dataclass(frozen=True, kw_only=True)
class CampaignPair(ControllerPair):
    """A controller of one campaign against one of the other."""

    controllers: tuple[str, str]
    any_failure: PairedFailures  # of a requirement, or an early end
    newly_lost: int  # flights that only the second one lost, on the same samples
    not_worse: Mapping[str, Gate]  # by metric; with unknowns that of the point that is worst


@dataclass(frozen=True)
class Compared:
    """Two campaigns, flight by flight."""

    requirements: tuple[str, ...]  # in words, as the pairs list them
    words: Mapping[str, Mapping[str, str]]  # of each metric
    paired: tuple[CampaignPair, ...]


@dataclass(frozen=True, kw_only=True)
class Baseline(Compared):
    """A campaign against an earlier one."""

    folder: str
    digest: str | None


def require_same_samples(
    mine: Mapping[str, Floats], theirs: Mapping[str, Floats], folder: Path, path: Path
) -> None:
    """Raise InputError about ``path``: the parameter and flight where its samples differ from ``folder``."""
    expected = f"the samples of {folder}"
    for name in mine:
        if name not in theirs:
            raise InputError(path, f"no column '{name}'", expected)
    for name in theirs:
        if name not in mine:
            raise InputError(path, f"a column '{name}'", f"{expected}, which have none")
    for name, values in mine.items():
        others = theirs[name]
        both = min(values.size, others.size)
        differ = np.flatnonzero(values[:both] != others[:both])
        if differ.size:
            k = int(differ[0])
            found = f"{name} = {float(others[k])!r} in flight {k}"
            raise InputError(path, found, f"{float(values[k])!r} as in {folder}")


def check_baseline(campaign: Experiment, baseline: Path) -> None:
    """Raise InputError, before anything flies, where a campaign's flights will not pair with those of a folder."""
    held = read_flown(baseline)
    source, unknowns = campaign.make_samples(), held.campaign.unknowns
    if unknowns.names != campaign.unknowns.names:
        expected = f"{', '.join(unknowns.names) or 'none'}, as in {baseline}"
        raise campaign.document.key_error(("unknowns",), "other unknowns", expected)
    drawn = source.draw(0, campaign.runs)[:: len(campaign.unknowns.points)]
    columns = {
        name: drawn[:, i] for i, name in enumerate(source.names) if name not in unknowns.names
    }
    theirs = {name: values[:: len(unknowns.points)] for name, values in _drawn(held).items()}
    require_same_samples(theirs, columns, baseline, campaign.document.path)
    if not set(campaign.controllers) & set(held.flights):
        expected = f"one of {', '.join(held.controllers)}, as in {baseline}"
        raise campaign.document.error(("controllers",), "no controller of the baseline", expected)


def _drawn(results: FlownCampaign) -> dict[str, Floats]:
    """Return the samples of the dispersions, without the values of unknowns."""
    unknowns = results.campaign.unknowns.names
    return {name: values for name, values in results.samples.items() if name not in unknowns}


def parse_margins(texts: Sequence[str]) -> dict[str, float]:
    """``METRIC=5%`` as shares by metric. Raises InputError."""
    margins = {}
    for text in texts:
        metric, sign, value = text.partition("=")
        try:
            margin = parse_in_unit(value.strip(), "-") if sign else -1.0
        except Refusal:
            margin = -1.0
        if margin < 0.0:
            raise InputError(
                "--fail-if-worse", f"'{text}'", "METRIC=SHARE, a share from 0 such as 5%"
            )
        if metric.strip() in margins:
            raise InputError(
                "--fail-if-worse", f"'{metric.strip()}' a second time", "each metric once"
            )
        margins[metric.strip()] = margin
    return margins


def read_compared(folder_a: Path, folder_b: Path) -> tuple[FlownCampaign, FlownCampaign]:
    """Read two campaigns on the same samples. Raise InputError if their samples differ."""
    return pair_campaigns(read_flown(folder_a), read_flown(folder_b))


def pair_campaigns(a: FlownCampaign, b: FlownCampaign) -> tuple[FlownCampaign, FlownCampaign]:
    """Return two campaigns at their common points of unknowns. Raise InputError if their samples differ."""
    a, b = at_common_points(a, b)
    require_same_samples(_drawn(a), _drawn(b), a.folder, CampaignFolder(b.folder).samples)
    return a, b


def compare_results(
    a: FlownCampaign,
    b: FlownCampaign,
    controllers: Sequence[str] = (),
    margins: Mapping[str, float] | None = None,
) -> Compared:
    """Compare each controller that both campaigns flew, on the same samples; requirements and metrics are those of `a`.

    `controllers` names two to compare across, the first campaign's and the second's. Where the numbers of flights
    differ, those that both flew are compared. `margins` are shares by which `b` may be worse in metrics.
    Raises InputError where nothing is in common.
    """
    metrics = [name for name in a.metrics if name in b.metrics]
    compared = [name for name in a.compared if name in metrics]
    records = a.campaign.metrics
    for metric in margins or {}:
        if metric not in metrics:
            raise InputError(
                "--fail-if-worse", f"unknown metric '{metric}'", one_of(metrics, metric)
            )
    requirements = tuple(item for item in a.campaign.requirements if item.metric in metrics)
    independent, unknowns = a.campaign.judged, a.campaign.unknowns
    pairs = []
    for one, other in pair_controllers(a, b, controllers):
        flights = sides(a, b, one, other)
        names = (f"{a.folder}: {one}", f"{b.folder}: {other}")
        found = compare_pair(
            *flights,
            names,
            metrics,
            compared,
            requirements=requirements,
            independent=independent,
            points=len(unknowns.points),
        )
        if found is not None:
            gates = {
                metric: _gate(*flights, metric, margin, requirements, unknowns=unknowns)
                for metric, margin in (margins or {}).items()
            }
            rows_a, rows_b = common_rows(*flights)
            newly_lost = flights[1].failed[rows_b] & ~flights[0].failed[rows_a]
            pairs.append(
                CampaignPair(
                    **vars(found),
                    controllers=(one, other),
                    any_failure=compare_any_failures(*flights, requirements),
                    newly_lost=int(newly_lost.sum()),
                    not_worse=gates,
                )
            )
    if not pairs:
        raise InputError(b.folder, "no flight that both campaigns flew", f"flights of {a.folder}")
    asked = tuple(requirement_words(item, records) for item in requirements)
    return Compared(asked, {name: records[name].as_texts() for name in metrics}, tuple(pairs))


def sides(
    a: FlownCampaign, b: FlownCampaign, one: str, other: str
) -> tuple[ControllerFlights, ControllerFlights]:
    """The flights of a controller of each campaign; what is bad in a metric is what `a` says."""
    return a.flights[one], replace(b.flights[other], records=a.campaign.metrics)


def compare_baseline(results: FlownCampaign, baseline: Path) -> Baseline:
    """A campaign against an earlier one on the same samples, as its report holds it. Raises InputError."""
    held = read_flown(baseline)
    before, after = at_common_points(held, results)
    require_same_samples(
        _drawn(before), _drawn(after), baseline, CampaignFolder(results.folder).samples
    )
    found = compare_results(after, before)
    held.refuse_changes()
    return Baseline(**vars(found), folder=baseline.as_posix(), digest=held.manifest.digest)


def gate_words(pair: CampaignPair, metric: str, b: str, requirements: Sequence[str]) -> str:
    """What a metric's gate says of the second one, called ``b``; the requirements of the comparison are in words."""
    gate, worst = pair.not_worse[metric], pair.metrics[metric].worst
    at = f"at {gate.at}, " if gate.at else ""
    words = f"{at}{b} {'passes' if gate.shown else 'is stopped'}: {'' if gate.within_low > 0.5 else 'NOT '}shown to be"
    words += f" at most {100.0 * gate.margin:g} % worse on more than half of the flights (on {gate.within} of "
    words += f"{gate.pairs} flown; with 95 % confidence on at least {percent(gate.within_low, 2)} of all)"
    reasons = [
        f"its {100.0 * level:.4g} % quantile is shown to be worse by more"
        for level in gate.worse_tails
    ]
    if gate.worst_doubled:
        reasons.append(
            f"its worst flight has {significant(worst[1])}, against {significant(worst[0])}"
        )
    reasons += ["it loses more flights"] if gate.loses_more else []
    reasons += [f"it misses {requirements[k]} more often" for k in gate.misses_more]
    return "; ".join([words, *reasons])


def _gate(
    a: ControllerFlights,
    b: ControllerFlights,
    metric: str,
    margin: float,
    requirements: Sequence[Requirement],
    *,
    unknowns: Unknowns,
) -> Gate:
    """What stops `b`, which may be so much worse; with unknowns at the point that stops it, or is nearest to it.

    `b` has to be shown not worse at each point, which costs no risk; the tests of whether it is worse share theirs.
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
        at = a.flight[rows_a] % points == point
        gate = judge_change(
            values[0][at],
            values[1][at],
            (lost[0][at], lost[1][at]),
            [(x[at], y[at]) for x, y in missed],
            margin,
            risk=RISK / points,
        )
        gates.append(replace(gate, at=unknowns.words(point) if unknowns.names else ""))
    return min(gates, key=lambda gate: (gate.shown, gate.within_low))


def pair_controllers(
    a: FlownCampaign, b: FlownCampaign, controllers: Sequence[str]
) -> Iterator[tuple[str, str]]:
    """Yield the controllers to compare: the two that are named, or each that both campaigns ran."""
    if controllers:
        if len(controllers) != 2:
            found = f"{len(controllers)} controllers"
            raise InputError("--controllers", found, "two: the first folder's and the second's")
        for name, results in zip(controllers, (a, b), strict=True):
            if name not in results.flights:
                expected = " or ".join(results.controllers)
                raise InputError(results.folder, f"no flights of '{name}'", expected)
        yield controllers[0], controllers[1]
        return
    common = [name for name in a.controllers if name in b.flights]
    if not common:
        found = f"the controllers {', '.join(b.controllers)}"
        raise InputError(b.folder, found, f"one of {', '.join(a.controllers)}")
    yield from ((name, name) for name in common)
