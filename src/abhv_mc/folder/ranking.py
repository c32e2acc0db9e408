"""The flights of all controllers in one order, the worst first: what is listed, drawn and kept follows it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.folder.controller_flights import ControllerFlights, read_flights
from abhv_mc.folder.flights import END_TIME
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.statistics.estimates import Criterion, worst_first


@dataclass(frozen=True)
class Ranking:
    """Lost flights first, the earliest before all others; then the largest distance beyond a limit."""

    controllers: tuple[str, ...]
    controller: NDArray[np.intp]  # [place] index of the controller
    row: NDArray[np.intp]  # [place] row among its flights
    beyond: Mapping[str, Floats]  # controller -> [row] largest distance, in its limit's unit; infinite where lost
    by: Mapping[str, NDArray[np.intp]]  # controller -> [row] the criterion of that distance

    def rows_of(self, name: str) -> NDArray[np.intp]:
        """The rows [flight] of a controller, the worst first."""
        return self.row[self.controller == self.controllers.index(name)]

    def places_of(self, name: str) -> NDArray[np.intp]:
        """The place of each row [flight] of a controller among the flights of all."""
        return np.flatnonzero(self.controller == self.controllers.index(name))[np.argsort(self.rows_of(name))]


def rank_flights(flights: Mapping[str, ControllerFlights], criteria: Sequence[Criterion]) -> Ranking:
    """Rank the flights of each controller; where a limit has no size, the first one's flights give the unit."""
    first = next(iter(flights.values()))
    scales = [criterion.scale(first.metrics[criterion.metric][~first.failed]) for criterion in criteria]
    beyond, by = {}, {}
    for name, each in flights.items():
        table = np.zeros((max(1, len(criteria)), each.flight.size))
        for i, (criterion, (start, unit)) in enumerate(zip(criteria, scales, strict=True)):
            table[i] = (criterion.excess(each.metrics[criterion.metric]) - start) / unit
        by[name] = np.argmax(table, axis=0)
        beyond[name] = np.where(each.failed, np.inf, table.max(axis=0))
    lost_at = [np.where(each.failed, each.end_time, np.inf) for each in flights.values()]
    order = worst_first(np.concatenate(lost_at), np.concatenate(list(beyond.values())))
    sizes = [each.flight.size for each in flights.values()]
    controller = np.repeat(np.arange(len(sizes)), sizes)[order]
    starts = np.cumsum([0, *sizes[:-1]])
    return Ranking(tuple(flights), controller, order - starts[controller], beyond, by)


def read_worst(folder: CampaignFolder, campaign: Experiment, number: int) -> dict[str, list[int]]:
    """Numbers of the worst flights of each controller, of those in the folder. Raises InputError without a flight."""
    criteria = campaign.criteria
    columns = {criterion.metric for criterion in criteria} | {END_TIME.name}
    held = read_flights(folder.flights, records=campaign.metrics, columns=columns, ends=campaign.outcomes)
    flights = {name: held[name] for name in campaign.controllers if name in held}
    ranking = rank_flights(flights, criteria)
    return {name: each.flight[ranking.rows_of(name)[:number]].tolist() for name, each in flights.items()}
