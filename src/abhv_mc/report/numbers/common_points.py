"""Campaigns with unknowns, restricted to the points that both of two ran, so that their flights pair."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abhv_mc.campaign.file.unknowns import Unknowns
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.io.input_error import InputError

_SAME = 1e-9  # relative difference of values that are one point


def at_common_points(a: FlownCampaign, b: FlownCampaign) -> tuple[FlownCampaign, FlownCampaign]:
    """Return both campaigns with the flights at the points of the unknowns that both ran.

    Sample k at common point p is flight ``k * points + p`` of both. Raises InputError for other unknowns, or if there
    is no common point.
    """
    mine, theirs = a.campaign.unknowns, b.campaign.unknowns
    if mine.names != theirs.names:
        found = f"the unknowns {', '.join(theirs.names) or 'of none'}"
        raise InputError(b.folder, found, f"{', '.join(mine.names) or 'none'}, as in {a.folder}")
    same = np.array(
        [
            (i, j)
            for i, one in enumerate(mine.points)
            for j, other in enumerate(theirs.points)
            if np.allclose(one, other, rtol=_SAME, atol=0.0)
        ]
    ).reshape(-1, 2)
    if not len(same):
        raise InputError(b.folder, "no common point of the unknowns", f"points of {a.folder}")
    return _restrict(a, same[:, 0]), _restrict(b, same[:, 1])


def _restrict(results: FlownCampaign, points: NDArray[np.intp]) -> FlownCampaign:
    """Return the results with the flights at some points, in this order."""
    total = len(results.campaign.unknowns.points)
    if np.array_equal(points, np.arange(total)):
        return results
    order = np.full(total, -1)
    order[points] = np.arange(len(points))

    def renumber(numbers: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
        """Return the new numbers in order, and the rows that have them."""
        place = order[numbers % total]
        rows = np.flatnonzero(place >= 0)
        new = (numbers // total * len(points) + place)[rows]
        return np.sort(new), rows[np.argsort(new)]

    flights = {}
    for name, flown in results.flights.items():
        number, rows = renumber(flown.flight)
        flights[name] = replace(
            flown,
            flight=number,
            outcome=flown.outcome[rows],
            metrics={metric: values[rows] for metric, values in flown.metrics.items()},
            absent=renumber(flown.absent)[0],
        )
    unknowns: Unknowns = replace(
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
