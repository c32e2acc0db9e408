"""What a campaign calls its controllers and metrics, for sentences, tables and figures."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from abhv_mc.flight.metrics import Metric
from abhv_mc.folder.results import Results
from abhv_mc.topics.labels import full_labels


@dataclass(frozen=True)
class Names:
    """Labels of the controllers, records of the metrics, and the folder as a command names it."""

    controllers: Mapping[str, str]  # name -> label, in the campaign's order
    metrics: Mapping[str, Metric]
    folder: str

    def label(self, controller: str) -> str:
        """How a controller is called in print."""
        return self.controllers.get(controller, controller)


def names_of(results: Results) -> Names:
    """The names of a campaign."""
    return make_names(results.folder, results.controllers, results.campaign.metrics)


def make_names(folder: Path, controllers: tuple[str, ...], metrics: Mapping[str, Metric]) -> Names:
    """The same from its parts."""
    return Names(full_labels(folder, controllers), metrics, shlex.quote(folder.as_posix()))
