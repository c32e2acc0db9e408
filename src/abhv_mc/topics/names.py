"""What a campaign calls its controllers and metrics, for sentences, tables and figures."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass

from abhv_mc.campaign.file.experiment import Requirement
from abhv_mc.flight.metrics import Metric
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.plant.parameters import OURS, Parameters
from abhv_mc.topics.labels import full_labels


@dataclass(frozen=True)
class Names:
    """Labels of the controllers, records of the metrics, and the folder as a command names it."""

    controllers: Mapping[str, str]  # name -> label, in the campaign's order
    metrics: Mapping[str, Metric]  # records by name
    asked: tuple[str, ...]  # the metrics that stand first
    requirements: tuple[Requirement, ...]
    folder: str
    design: str = "random"  # of its samples
    independent: bool = True  # whether its flights are independent draws, so that exact statistics hold
    judged: bool = True  # whether those at each value of its unknowns are, so that there are verdicts and winners
    parameters: Parameters = OURS  # what its flights are given
    kind: str = "controller"  # what is judged, in a word
    flies: bool = True  # whether a flight can be flown again: not where a table was adopted

    def label(self, controller: str) -> str:
        """How a controller is called in print."""
        return self.controllers.get(controller, controller)


def names_of(results: FlownCampaign) -> Names:
    """The names of a campaign."""
    labels = full_labels(results.folder, results.controllers)
    campaign, folder = results.campaign, shlex.quote(results.folder.as_posix())
    asked, requirements = results.asked, campaign.requirements
    design = "several-point" if campaign.unknowns.names else campaign.sampling
    known = campaign.independent, campaign.judged, campaign.parameters, campaign.kind, not campaign.adopted
    return Names(labels, campaign.metrics, asked, requirements, folder, design, *known)
