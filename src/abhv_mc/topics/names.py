"""What a campaign calls its controllers and metrics, for sentences, tables and figures."""

import os
import re
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from abhv_mc.campaign.file.experiment import Experiment, Requirement
from abhv_mc.flight.metrics import Metric
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.shipped import shipped_files

_INITIALS = ("tlc", "lqr")


def controller_label(name: str) -> str:
    """A controller's name as it is printed: 'LQR robust' of 'lqr_robust'."""
    return " ".join(word.upper() if word in _INITIALS else word for word in name.split("_"))


def full_labels(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Labels of a campaign's controllers that say which of them is the paper's LQR, as it is not the best one."""
    paper = _controller_text(shipped_files("control")["lqr"])
    flown = {name: folder / "inputs" / "controllers" / name / "lqr.yaml" for name in names}
    return {
        name: controller_label(name)
        + (" (paper's weights)" if path.is_file() and _controller_text(path) == paper else "")
        for name, path in flown.items()
    }


def _controller_text(path: Path) -> bytes:
    """Return a controller file's content without the line by which editors find its schema, which `new` writes."""
    return re.sub(rb"\A# yaml-language-server:.*\n", b"", path.read_bytes())


@dataclass(frozen=True)
class Names:
    """Labels of the controllers, records of the metrics, the folder as a command names it; and what both stand for."""

    controllers: Mapping[str, str]  # name -> label, in the campaign's order
    metrics: Mapping[str, Metric]  # records by name
    asked: tuple[str, ...]  # the metrics that stand first
    requirements: tuple[Requirement, ...]
    folder: str
    campaign: Experiment
    results: FlownCampaign = field(repr=False)

    def label(self, controller: str) -> str:
        """How a controller is called in print."""
        return self.controllers.get(controller, controller)


def names_of(results: FlownCampaign, page: Path | None = None) -> Names:
    """Return the names of a campaign; commands name its folder relative to that of the ``page``, if there is one."""
    labels, campaign = full_labels(results.folder, results.controllers), results.campaign
    place = results.folder
    if page is not None:
        place = Path(os.path.relpath(place.absolute(), page.absolute()))
    folder = shlex.quote(place.as_posix())
    return Names(
        labels, campaign.metrics, results.asked, campaign.requirements, folder, campaign, results
    )
