"""Points of the unknown parameters at which requirements are judged.

An unknown has the same value in every flight of a programme, but only its bounds are known.
Dispersions are drawn for each flight; requirements, in contrast, are judged at points of the box of
unknowns, which has coordinates from -1 (lower bound) to 1 (upper bound). All points use the same
samples of the dispersions.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.statistics.verdicts import Status, Verdict

SEARCH_FLIGHTS = 256  # maximum number of search flights per point
FEWEST_SEARCHED = 32  # minimum number of search flights per point, for small campaigns
SEARCH_QUANTILE = 0.95  # quantile of the severities by which points are ranked
MOST_UNKNOWNS = 64
_HALTON = 32
# search steps per requirement: near the worst point, and near the worst point that is not a corner
_STEPS = 64
# initial step, in half widths of the box, and the factor on the step after each step without
# improvement
_FIRST_STEP, _SHRINK = 0.5, 0.95
# largest numbers of unknowns for which all corners are judged and tried, respectively
_ALL_CORNERS_FLOWN, _ALL_CORNERS_TRIED = 4, 7
# expected number of failures at which a search finds the point with a probability of about one half
_SHOWING = 2


class Trial(NamedTuple):
    """Results of the search flights at points, by requirement; larger values are worse."""

    severity: Floats  # severity quantile that ranks the points [point, requirement]
    failures: Ints  # number of failures [point, requirement]
    largest: Floats  # severity of the worst flight [point, requirement]


class Search(NamedTuple):
    """Distinct points tried for one controller, with their results."""

    points: Floats  # coordinates [point, unknown]
    trial: Trial


class MostFailures(NamedTuple):
    """Judged point at which a search observed the most failures to meet a requirement."""

    search: int  # index of the controller
    requirement: int
    point: int
    failures: int  # number of failures among the search flights at the point


class JudgedPoints(NamedTuple):
    """Points at which requirements are judged; the first `shared` points apply to each."""

    points: Floats  # coordinates [point, unknown]
    shared: int
    most_failures: tuple[MostFailures, ...]  # additional points, each for a single requirement


def corners(unknowns: int) -> Floats:
    """Return all corners [corner, unknown], or 128 corners for more than seven unknowns.

    The 128 corners are a design of resolution IV: each further column is a product of an odd number
    of the first seven columns, so that no main effect is confounded with an interaction of two
    unknowns, and the opposite of each corner is included (Box, Hunter & Hunter 2005, chapter 6).
    """
    full = np.array(list(product((-1.0, 1.0), repeat=min(unknowns, _ALL_CORNERS_TRIED))))
    if unknowns <= _ALL_CORNERS_TRIED:
        return full
    generators = [
        generator
        for generator in product((False, True), repeat=_ALL_CORNERS_TRIED)
        if sum(generator) % 2
    ]
    generators.sort(key=lambda generator: (sum(generator) > 1, -sum(generator)))
    return np.column_stack([full[:, generator].prod(axis=1) for generator in generators[:unknowns]])


def search_worst(
    evaluate: Callable[[Floats], Trial], unknowns: int, draw: np.random.Generator
) -> Search:
    """Search for the values of the unknowns that are the worst for each requirement.

    ``evaluate`` simulates the flights at points [point, unknown]. Corners, centre and Halton points
    are tried first. Then two chains of Gaussian steps are run for each requirement, from the worst
    point and from the worst point that is not a corner.
    """
    from scipy.stats import qmc

    ends = corners(unknowns)
    halton = 2.0 * qmc.Halton(unknowns, rng=draw).random(_HALTON) - 1.0
    tried = np.vstack([ends, np.zeros((1, unknowns)), halton])
    first = evaluate(tried)
    points, trials = [tried], [first]
    inner = first.severity[len(ends) :].argmax(axis=0) + len(ends)
    # index of the requirement that each chain searches
    columns = np.tile(np.arange(first.severity.shape[1]), 2)
    best = np.concatenate([first.severity.argmax(axis=0), inner])
    center, worst = tried[best], first.severity[best, columns]
    size = np.full(len(best), _FIRST_STEP)
    for _ in range(_STEPS // 2):
        step = np.clip(center + size[:, None] * draw.standard_normal(center.shape), -1.0, 1.0)
        trial = evaluate(step)
        points.append(step)
        trials.append(trial)
        value = trial.severity[np.arange(len(step)), columns]
        worse = value > worst
        center[worse], worst[worse] = step[worse], value[worse]
        size[~worse] *= _SHRINK
    tried = np.vstack(points)
    # Clipping may move several trial points to the same corner.
    _, unique = np.unique(tried, axis=0, return_index=True)
    rows = np.sort(unique)
    return Search(
        tried[rows], Trial(*(np.vstack(values)[rows] for values in zip(*trials, strict=True)))
    )


def search_size(runs: int) -> int:
    """Return the number of search flights per point, given ``runs`` flights per point."""
    return min(SEARCH_FLIGHTS, max(FEWEST_SEARCHED, runs))


def search_flights(unknowns: int, requirements: int, runs: int) -> int:
    """Return the number of flights in the search for one controller."""
    return search_size(runs) * (len(corners(unknowns)) + 1 + _HALTON + requirements * _STEPS)


def most_points(unknowns: int, searches: int) -> int:
    """Return the largest number of judged points for `searches` controller-requirement pairs."""
    return len(standing_points(unknowns)) + searches * (2 if unknowns <= _ALL_CORNERS_FLOWN else 4)


def standing_points(unknowns: int) -> Floats:
    """Return the points [point, unknown] that are always judged.

    The points are the centre and, for up to four unknowns, all corners.
    """
    ends = corners(unknowns) if unknowns <= _ALL_CORNERS_FLOWN else np.empty((0, unknowns))
    return np.vstack([ends, np.zeros((1, unknowns))])


def choose_points(
    unknowns: int, searches: Sequence[Search], extra_points: Floats | None = None
) -> JudgedPoints:
    """Choose the points at which requirements are judged, from each controller's search.

    For up to four unknowns, the points are all corners, the centre and the worst point for each
    controller and requirement. For more unknowns, only the worst corners and their opposites are
    used instead of all corners. Each requirement is also judged at the point with the most failures
    in a search, unless a judged point had as many failures, because the quantile that ranks points
    ignores failures in less than 5 % of the flights. Without any failure, the point of the flight
    nearest to the limit is used. `extra_points` [point, unknown] are added.
    """
    ends, rows = corners(unknowns), [*standing_points(unknowns)]
    for points, trial in searches:
        if unknowns > _ALL_CORNERS_FLOWN:
            worst = ends[trial.severity[: len(ends)].argmax(axis=0)]
            rows += [*worst, *-worst]
        rows += [*points[trial.severity.argmax(axis=0)]]
    rows += [] if extra_points is None else [*extra_points]
    judged = list(dict.fromkeys(_key(row) for row in rows))
    shared, most = len(judged), list[MostFailures]()
    for search, (points, trial) in enumerate(searches):
        keys = [_key(point) for point in points]
        for requirement in range(trial.failures.shape[1]):
            failures, largest = trial.failures[:, requirement], trial.largest[:, requirement]
            own = {*judged[:shared]}
            own |= {judged[entry.point] for entry in most if entry.requirement == requirement}
            nearest = np.where(failures == 0, largest, 0.0)
            order = np.lexsort([trial.severity[:, requirement], nearest, failures])
            worst_first = order[::-1].tolist()
            point = worst_first[0]
            equal_point = next((i for i in worst_first if keys[i] in own), None)
            if (
                equal_point is not None
                and failures[equal_point] == failures[point]
                and nearest[equal_point] == nearest[point]
            ):
                point = equal_point
            if keys[point] not in judged:
                judged.append(keys[point])
            index = judged.index(keys[point])
            most.append(MostFailures(search, requirement, index, int(failures[point])))
    return JudgedPoints(np.array(judged), shared, tuple(most))


def _key(point: Floats) -> tuple[float, ...]:
    return tuple((point + 0.0).tolist())


def showing_factor(probability: float, flights: int = SEARCH_FLIGHTS) -> float:
    """Return the factor of excess failures that a search detects with a chance of about 1/2.

    At this factor, two failures are expected; see `benchmarks/unknowns.py` for a simulation.
    """
    return _SHOWING / (flights * (1.0 - probability))


def judge_points(verdicts: Sequence[Verdict]) -> tuple[Verdict, int]:
    """Return the verdict over all points, and the index of the point furthest from a PASS.

    The verdict contains the counts at that point. PASS requires a PASS at every point: this is an
    intersection-union test, whose risk is the risk at a single point (Berger 1982). FAIL requires
    that the mean of the points' E_fail reaches 1 / producer_risk: if every point meets the
    requirement, each E_fail is an e-value at any number of flights, and so is their mean (Vovk &
    Wang 2021).
    """
    if len(verdicts) == 1:
        return verdicts[0], 0
    worst = min(range(len(verdicts)), key=lambda i: verdicts[i].E_pass)
    worst_verdict = verdicts[worst]
    missed = float(np.mean([verdict.E_fail for verdict in verdicts]))
    passes = all(verdict.status == "PASS" for verdict in verdicts)
    status: Status = (
        "PASS" if passes else "FAIL" if missed >= 1.0 / worst_verdict.producer_risk else "NOT SHOWN"
    )
    return replace(worst_verdict, status=status, E_fail=missed), worst
