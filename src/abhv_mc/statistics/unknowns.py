"""Unknowns: values that are the same in every flight of a programme, and of which only bounds are known.

A dispersion is drawn anew for each flight; an unknown is not, so it is judged at points of its box, each coordinate
from -1 (its low end) to 1 (its high end). Every point flies the same samples of the dispersions.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.statistics.verdicts import Status, Verdict

SEARCH_FLIGHTS = 256  # at each point that is tried
SEARCH_QUANTILE = 0.95  # of their severity beyond the limit, by which points are ranked
MOST_UNKNOWNS = 64
_HALTON = 32
_STEPS = 64  # for each requirement; half of them about the worst of all, half about the worst that is no corner
_FIRST_STEP, _SHRINK = 0.5, 0.95  # half-boxes; at each miss
_ALL_CORNERS_FLOWN, _ALL_CORNERS_TRIED = 4, 7  # unknowns


def corners(unknowns: int) -> Floats:
    """All corners ``[2**unknowns, unknown]``; beyond seven unknowns 128 of them, a design of resolution IV.

    Each further column is a product of an odd number of the first seven, so that no sum of two unknowns' effects hides
    that of a third, and the opposite of every corner is there (Box, Hunter & Hunter 2005, chapter 6).
    """
    full = np.array(list(product((-1.0, 1.0), repeat=min(unknowns, _ALL_CORNERS_TRIED))))
    if unknowns <= _ALL_CORNERS_TRIED:
        return full
    words = [word for word in product((False, True), repeat=_ALL_CORNERS_TRIED) if sum(word) % 2]
    words.sort(key=lambda word: (sum(word) > 1, -sum(word)))
    return np.column_stack([full[:, word].prod(axis=1) for word in words[:unknowns]])


def search_worst(
    severity: Callable[[Floats], Floats], unknowns: int, draw: np.random.Generator
) -> tuple[Floats, Floats]:
    """Points tried ``[point, unknown]`` and their severities ``[point, requirement]``, larger being worse.

    ``severity`` gives those of points. Corners, centre and Halton points are tried first, in this order, then for
    each requirement two chains of Gaussian steps, from the worst of all and from the worst that is no corner.
    """
    from scipy.stats import qmc

    ends = corners(unknowns)
    halton = 2.0 * qmc.Halton(unknowns, rng=draw).random(_HALTON) - 1.0
    tried = np.vstack([ends, np.zeros((1, unknowns)), halton])
    found = severity(tried)
    inner = found[len(ends) :].argmax(axis=0) + len(ends)
    columns = np.tile(np.arange(found.shape[1]), 2)  # of the chains
    best = np.concatenate([found.argmax(axis=0), inner])
    center, worst = tried[best], found[best, columns]
    size = np.full(len(best), _FIRST_STEP)
    for _ in range(_STEPS // 2):
        step = np.clip(center + size[:, None] * draw.standard_normal(center.shape), -1.0, 1.0)
        values = severity(step)
        tried, found = np.vstack([tried, step]), np.vstack([found, values])
        value = values[np.arange(len(step)), columns]
        worse = value > worst
        center[worse], worst[worse] = step[worse], value[worse]
        size[~worse] *= _SHRINK
    return tried, found


def search_flights(unknowns: int, requirements: int) -> int:
    """Flights of a search of one controller."""
    return SEARCH_FLIGHTS * (len(corners(unknowns)) + 1 + _HALTON + requirements * _STEPS)


def most_points(unknowns: int, searches: int) -> int:
    """The most points that are judged where so many pairs of controller and requirement are searched."""
    return len(standing_points(unknowns)) + searches * (1 if unknowns <= _ALL_CORNERS_FLOWN else 3)


def standing_points(unknowns: int) -> Floats:
    """Points ``[point, unknown]`` judged whatever a search finds: the centre, and all corners of up to four."""
    ends = corners(unknowns) if unknowns <= _ALL_CORNERS_FLOWN else np.empty((0, unknowns))
    return np.vstack([ends, np.zeros((1, unknowns))])


def points_flown(unknowns: int, searched: Sequence[tuple[Floats, Floats]]) -> Floats:
    """Points ``[point, unknown]`` at which requirements are judged, from what a search of each controller gave.

    Up to four unknowns all corners and the centre, then each requirement's worst; beyond four, in place of all corners
    each requirement's worst and its opposite.
    """
    ends, rows = corners(unknowns), [*standing_points(unknowns)]
    for points, values in searched:
        if unknowns > _ALL_CORNERS_FLOWN:
            worst = ends[values[: len(ends)].argmax(axis=0)]
            rows += [*worst, *-worst]
        rows += [*points[values.argmax(axis=0)]]
    return np.array(list(dict.fromkeys(tuple((row + 0.0).tolist()) for row in rows)))


def judge_points(verdicts: Sequence[Verdict]) -> tuple[Verdict, int]:
    """The verdict over points from that of each, and the point that is furthest from a PASS, whose counts it has.

    PASS where every point passes: an intersection-union test, whose risk is that of one point (Berger 1982). FAIL where
    the mean of the points' E_fail reaches 1 / producer_risk: if every point meets the requirement each E_fail is an
    e-value at any number of flights, and so is their mean (Vovk & Wang 2021).
    """
    if len(verdicts) == 1:
        return verdicts[0], 0
    worst = min(range(len(verdicts)), key=lambda i: verdicts[i].E_pass)
    at = verdicts[worst]
    missed = float(np.mean([verdict.E_fail for verdict in verdicts]))
    passes = all(verdict.status == "PASS" for verdict in verdicts)
    status: Status = (
        "PASS" if passes else "FAIL" if missed >= 1.0 / at.producer_risk else "NOT SHOWN"
    )
    return replace(at, status=status, E_fail=missed), worst
