"""Names of a campaign's controllers and metrics in sentences, tables and figures."""

import os
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from abhv_mc.campaign.file.experiment import Experiment, Requirement
from abhv_mc.flights.metrics import Metric
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.folder.inputs import content_of
from abhv_mc.shipped import shipped_files

_INITIALS = ("tlc", "lqr")


def controller_label(name: str) -> str:
    """Return a controller's printed name, such as 'LQR robust' for 'lqr_robust'."""
    return " ".join(word.upper() if word in _INITIALS else word for word in name.split("_"))


def full_labels(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Return the printed names of a campaign's controllers; the LQR of the paper is marked."""
    paper = content_of(shipped_files("control")["lqr"])
    flown = {name: folder / "inputs" / "controllers" / name / "lqr.yaml" for name in names}
    return {
        name: controller_label(name)
        + (" (paper's weights)" if path.is_file() and content_of(path) == paper else "")
        for name, path in flown.items()
    }


@dataclass(frozen=True)
class Names:
    """Printed names of a campaign's controllers and metrics, with the campaign's results."""

    controllers: Mapping[str, str]  # controller -> label, in the campaign's order
    metrics: Mapping[str, Metric]  # metric records by name
    asked: tuple[str, ...]  # names of the leading metrics
    requirements: tuple[Requirement, ...]
    folder: str
    campaign: Experiment
    results: FlownCampaign = field(repr=False)

    @property
    def kind(self) -> str:
        """Heading of columns of controllers, such as 'Controller'."""
        return self.campaign.kind.capitalize()

    def label(self, controller: str) -> str:
        """Return a controller's printed name."""
        return self.controllers.get(controller, controller)


def names_of(results: FlownCampaign, page: Path | None = None) -> Names:
    """Return a campaign's names; the results folder is relative to folder ``page``, if given."""
    campaign, target = results.campaign, results.folder
    if page is not None:
        target = Path(os.path.relpath(target.absolute(), page.absolute()))
    return Names(
        controllers=full_labels(results.folder, results.controllers),
        metrics=campaign.metrics,
        asked=results.asked,
        requirements=campaign.requirements,
        folder=shlex.quote(target.as_posix()),
        campaign=campaign,
        results=results,
    )
