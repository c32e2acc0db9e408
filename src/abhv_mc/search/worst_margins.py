"""``abhv-mc margins CAMPAIGN --worst``: the least margins over dispersions and unknowns, by linear analysis alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.flight.metrics import MARGIN_NAMES
from abhv_mc.search.methods.worst import search_worst
from abhv_mc.search.space import make_space
from abhv_mc.simulators.margin_plans import TrimMargins, trim_margins

EVALUATIONS = 512  # of each margin
_BOX = 3.0  # sigma of unbounded distributions
_MOVED = 1e-6  # half widths of the range


@dataclass(frozen=True)
class WorstMargin:
    """The least of one margin that was found; the true least is no greater."""

    controller: str
    metric: str
    nominal: float  # in the metric's unit; 0 where it is unstable, or has no trim
    found: float
    parameters: dict[str, float]  # where, SI
    moved: tuple[str, ...]  # of them, those that are off the middle of their range, the farthest first
    fault: str  # 'unstable', why there is no trim, or ''
    evaluations: int


def find_worst_margins(campaign: Experiment, controllers: Sequence[str]) -> list[WorstMargin]:
    """The least of each margin of each controller in steady flight at the mission's start.

    Of unbounded distributions up to three sigma. Nothing flies. Raises InputError where there can be no margins.
    """
    space = make_space(campaign, with_unknowns=True)
    bounds, seed = space.bounds(_BOX), campaign.model.seed
    found = []
    for name, margins in trim_margins(campaign, controllers).items():
        nominal = margins(nominal_parameters())[0][0]
        for k, metric in enumerate(MARGIN_NAMES):

            def evaluate(points: Floats, k: int = k, margins: TrimMargins = margins) -> Floats:
                values = space.complete(space.from_box(points, bounds), seed, None)
                return -margins(space.rows(values))[0][:, k]

            case = search_worst(evaluate, len(space.names), EVALUATIONS, seed)
            values = space.from_box(case.place[None], bounds)
            least, faults = margins(space.rows(space.complete(values, seed, None)))
            found.append(
                WorstMargin(
                    name,
                    metric,
                    float(nominal[k]),
                    float(least[0, k]),
                    dict(zip(space.names, values[0].tolist(), strict=True)),
                    tuple(space.names[i] for i in np.argsort(-np.abs(case.place)) if abs(case.place[i]) > _MOVED),
                    faults[0],
                    len(case.values),
                )
            )
    return found
