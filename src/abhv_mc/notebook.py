"""Campaigns in a notebook: a file, or its content, to fly."""

import os
import shutil
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any

from abhv_mc.campaign import MOST_WORKERS
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.references import find_references
from abhv_mc.campaign_results import CampaignResults, as_html
from abhv_mc.flying import check_count, check_mapping, make_document
from abhv_mc.io.documents import write_document

if TYPE_CHECKING:
    import pandas as pd


Paths = str | Path


class Campaign:
    """A campaign file, read and checked; :meth:`run` flies it."""

    def __init__(self, path: Path, checked: Experiment) -> None:
        self.path, self._checked = path.absolute(), checked  # whoever changes the working folder means no other
        self.name: str = checked.model.name
        self.question: str = checked.model.question  # what it asks
        self.runs: int = checked.runs  # flights of each controller
        self.controllers: tuple[str, ...] = tuple(checked.model.controllers)  # the first is compared with the others
        self.parameters: tuple[str, ...] = checked.names  # that are dispersed

    @classmethod
    def read(cls, path: Paths) -> "Campaign":
        """Read a campaign file. Raises :class:`abhv_mc.io.documents.InputError` with everything that is wrong."""
        return cls(Path(path), read_campaign(path))

    @classmethod
    def make(cls, data: Mapping[str, Any], **overrides: Any) -> "Campaign":
        """A campaign from its file's content: ``Campaign.make({"name": "study", "mission": "turn", ...})``.

        Vehicle, mission and controllers are shipped names, paths or mappings, with ``base`` and the entries that differ
        (see :func:`abhv_mc.fly`): so a gain sweep is a dict of controllers. ``overrides`` replace entries, such as
        ``runs=200``. Raises :class:`abhv_mc.io.documents.InputError` with everything that is wrong.
        """
        place = mkdtemp(prefix="abhv-mc-")
        try:
            path = write_inputs({**check_mapping(data, "data"), **overrides}, Path(place))
            made = cls(path, read_campaign(path))
        except BaseException:
            shutil.rmtree(place, ignore_errors=True)
            raise
        weakref.finalize(made, shutil.rmtree, place, ignore_errors=True)  # a flown campaign has copies in its folder
        return made

    def draw_samples(self, flights: int | None = None) -> "pd.DataFrame":
        """The dispersions that the first flights will have (all by default), SI, one column a parameter."""
        import pandas as pd

        source = self._checked.make_samples()
        number = self.runs if flights is None else min(check_count(flights, 0, "flights"), self.runs)
        index = pd.RangeIndex(number, name="flight")
        return pd.DataFrame(source.draw(0, number), columns=list(source.names), index=index)

    def run(
        self,
        output: Paths | None = None,
        runs: int | None = None,
        seed: int | None = None,
        controllers: Sequence[str] | None = None,
        workers: int | None = None,
        fresh: bool = False,
    ) -> "CampaignResults":
        """Fly it, or what its folder misses of it, as ``abhv-mc run`` does, and open the results.

        ``output`` is ``reports/<name>`` by default; ``fresh`` deletes what it holds first. The other arguments
        override the file. An interrupt keeps what was flown (``results.complete`` is False); the same call goes on.
        Raises :class:`abhv_mc.io.documents.InputError` for what is wrong, and ``StorageFullError`` on a full disk.
        """
        from abhv_mc.execution.runner import run_campaign
        from abhv_mc.execution.setup import Request

        names = tuple(controllers) if controllers is not None else None
        if workers is not None:
            workers = check_count(workers, 1, "workers", MOST_WORKERS)
        out = Path(output) if output is not None else None
        return CampaignResults(run_campaign(Request(self.path, out, runs, seed, names, workers, fresh)).folder)

    def _repr_html_(self) -> str:
        """What a notebook shows: what it asks, who flies, and what is dispersed."""
        head = f"{self.name}: {self.runs} flights each. {self.question}"
        data: Any = self._checked.document.data
        entries = data.get("dispersions") or {}
        rows = [("controllers", ", ".join(self.controllers), "")]
        rows += [(name, ", ".join(f"{k} {v}" for k, v in entry.items()), "") for name, entry in entries.items()]
        return as_html(head, rows)

    def __repr__(self) -> str:
        return (
            f"<Campaign {self.name}: {self.runs} flights of {', '.join(self.controllers)}, "
            f"{len(self.parameters)} dispersions>"
        )


def write_inputs(data: Mapping[str, Any], folder: Path) -> Path:
    """Write a campaign and all that it refers to into a folder; the campaign's path. Raises InputError."""
    content = dict(data)
    for key, kind in (("vehicle", "vehicle"), ("mission", "mission")):
        if key in content:
            content[key] = _write_input(kind, content[key], folder, key)
    controllers = content.get("controllers")
    if isinstance(controllers, str):
        controllers = {Path(controllers).stem: controllers}
    if isinstance(controllers, Mapping):
        content["controllers"] = {
            str(name): _write_input("control", given, folder, f"controllers/{number}")
            for number, (name, given) in enumerate(controllers.items())
        }
    path = folder / "campaign.yaml"
    write_document(path, content)
    return path


def _write_input(kind: str, given: Any, folder: Path, place: str) -> str:
    """Write an input and the files that it names, these as they lie to each other; its path from the folder."""
    document = make_document(kind, given)
    path = document.path.resolve()
    files = list(find_references(path)) if path.is_file() else []
    root = Path(os.path.commonpath([file.parent for file in (path, *files)]))
    for file in files:
        target = folder / place / file.relative_to(root)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
    name = path.relative_to(root) if path.is_file() else Path(f"{kind}.yaml")
    (folder / place / name).parent.mkdir(parents=True, exist_ok=True)
    write_document(folder / place / name, document.data)
    return f"{place}/{name.as_posix()}"
