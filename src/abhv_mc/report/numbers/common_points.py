"""Selection of the points of the unknown parameters that two campaigns have in common."""

from dataclasses import replace

import numpy as np

from abhv_mc.array_types import Indices, Ints
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.io.messages import InputError, quoted

_SAME = 1e-9  # relative tolerance within which points count as equal


def restrict_to_common_points(
    a: FlownCampaign, b: FlownCampaign
) -> tuple[FlownCampaign, FlownCampaign]:
    """Return both campaigns, restricted to flights at their common points of the unknowns.

    Sample k at common point p is flight ``k * points + p`` in both
    campaigns. Raise InputError if the
    unknowns differ or there is no common point.
    """
    unknowns_a, unknowns_b = a.campaign.unknowns, b.campaign.unknowns
    if unknowns_a.names != unknowns_b.names:
        problem = (
            f"the unknowns are {quoted(unknowns_b.names)}"
            if unknowns_b.names
            else "the campaign has no unknowns"
        )
        raise InputError(b.folder, problem, f"{quoted(unknowns_a.names)}, as in {a.folder}")
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
    return _restrict(a, pairs[:, 0]), _restrict(b, pairs[:, 1])


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
