"""Public interface: campaigns, results, flights, trims, linear models and searches.

``abhv_mc`` re-exports these names; large modules are imported on first use.
"""

import os
import shutil
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.io.documents import InputError, InputErrors
from abhv_mc.one_flight.fly_once import fly
from abhv_mc.one_flight.given import check_mapping, write_inputs
from abhv_mc.one_flight.linear_models import LinearModel, StateSpace, fly_on, linearize, margins
from abhv_mc.one_flight.trim_table import trim
from abhv_mc.requests import (
    Paths,
    RareRequest,
    Request,
    WorstRequest,
    check_count,
    takes,
)
from abhv_mc.results import Results, as_html, open_results
from abhv_mc.shipped import find_input

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from abhv_mc.report.pages.compare_page import Comparison
    from abhv_mc.search.rare import RareFound
    from abhv_mc.search.worst import WorstFound

__all__ = [
    "Campaign",
    "InputError",
    "InputErrors",
    "LinearModel",
    "Results",
    "StateSpace",
    "compare",
    "fly",
    "fly_on",
    "linearize",
    "margins",
    "open_results",
    "rare",
    "simulate",
    "trim",
    "worst",
]


class Campaign:
    """Checked campaign file; :meth:`run` runs it. It is accepted wherever its path is."""

    def __init__(self, path: Path, checked: Experiment) -> None:
        self.path, self._checked = (
            path.absolute(),
            checked,
        )  # independent of later changes of the working folder
        self.name: str = checked.model.name
        self.question: str = checked.model.question  # what it asks
        self.runs: int = checked.runs  # flights of each controller
        self.controllers: tuple[str, ...] = (
            checked.controllers
        )  # the first is compared with the others
        self.parameters: tuple[str, ...] = checked.names  # that are dispersed

    def __fspath__(self) -> str:
        return str(self.path)

    @classmethod
    def read(cls, path: Paths) -> "Campaign":
        """Read a campaign file. Raise InputError with all problems."""
        return cls(Path(path), read_campaign(path))

    @classmethod
    def make(cls, data: Mapping[str, Any], **overrides: Any) -> "Campaign":
        """Return a campaign from the content of its file.

        ``Campaign.make({"name": "study", "mission": "turn", ...})``: vehicle, mission and
        controllers are shipped names, paths or mappings, with ``base`` and the entries that differ
        (see :func:`abhv_mc.fly`), so that a gain sweep is a dict of controllers. ``overrides``
        replace entries, such as ``runs=200``. Raise InputError with all problems.
        """
        folder = mkdtemp(prefix="abhv-mc-")
        try:
            path = write_inputs({**check_mapping(data, "data"), **overrides}, Path(folder))
            campaign = cls(path, read_campaign(path))
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        weakref.finalize(
            campaign, shutil.rmtree, folder, ignore_errors=True
        )  # a flown campaign has copies in its folder
        return campaign

    def draw_samples(self, flights: int | None = None) -> "pd.DataFrame":
        """Return the dispersions of the first flights (default: all), SI, one column each."""
        import pandas as pd

        source = self._checked.make_samples()
        number = (
            self.runs if flights is None else min(check_count(flights, 0, "flights"), self.runs)
        )
        index = pd.RangeIndex(number, name="flight")
        return pd.DataFrame(source.draw(0, number), columns=list(source.names), index=index)

    @takes(Request, of="campaign")
    def run(request: Request) -> "Results":  # noqa: N805  of which the campaign is a part
        """Run the campaign, or its missing flights, as ``abhv-mc run`` does; return the results.

        Returns
        -------
        Results
            After an interrupt completed flights are kept (``.complete`` is False); the same call
            resumes.

        Raises
        ------
        InputError
            If an input is invalid; StorageFullError on a full disk.
        """
        from abhv_mc.execution.runner import run_campaign

        return Results(run_campaign(request).folder)

    def _repr_html_(self) -> str:
        """Return question, controllers and dispersions as HTML for notebooks."""
        head = f"{self.name}: {self.runs} flights each. {self.question}"
        data = self._checked.document.entries
        entries = data.get("dispersions") or {}
        rows = [("controllers", ", ".join(self.controllers), "")]
        rows += [
            (name, ", ".join(f"{k} {v}" for k, v in entry.items()), "")
            for name, entry in entries.items()
        ]
        return as_html(head, rows)

    def __repr__(self) -> str:
        return (
            f"<Campaign {self.name}: {self.runs} flights of {', '.join(self.controllers)}, "
            f"{len(self.parameters)} dispersions>"
        )


@takes(WorstRequest)
def worst(request: WorstRequest) -> "WorstFound":
    """Search a campaign's dispersions for the worst value of a metric.

    ``abhv-mc worst`` does the same.

    Returns
    -------
    WorstFound
        ``.numbers()`` is what ``--json`` holds.

    Raises
    ------
    InputError
        For what is wrong with a file or an argument.
    """
    from abhv_mc.report.pages.page import write_answer
    from abhv_mc.report.pages.worst_page import make_worst_answer
    from abhv_mc.search.worst import find_worst

    result, folder = find_worst(request), Path(request.output)
    write_answer(make_worst_answer(result, folder), folder / "report.html")
    return result


@takes(RareRequest)
def rare(request: RareRequest) -> "RareFound":
    """Estimate the probability that a flight violates a requirement.

    ``abhv-mc rare`` does the same.

    Returns
    -------
    RareFound
        ``.numbers()`` is the content of ``--json``: its probability is None if repetitions
        contradict each other or the surrogate does not converge (``.estimate.refusal`` is the
        reason).

    Raises
    ------
    InputError
        For what is wrong with a file or an argument.
    """
    from abhv_mc.report.pages.page import write_answer
    from abhv_mc.report.pages.rare_page import make_rare_answer
    from abhv_mc.search.rare import find_rare

    result, folder = find_rare(request), Path(request.output)
    write_answer(make_rare_answer(result, folder), folder / "report.html")
    return result


def simulate(
    campaign: Paths,
    inputs: "pd.DataFrame",
    controllers: Sequence[str] | None = None,
    channels: Sequence[str] = (),
) -> "xr.Dataset":
    """Simulate a table of inputs with a campaign's controllers in memory.

    No files are written. Needs the extra ``xarray``.

    Parameters
    ----------
    campaign
        Campaign with the vehicle, mission, controllers and metrics.
    inputs
        A row a flight, a column a parameter, SI; parameters without a column are nominal. The rows of
        :meth:`Campaign.draw_samples` give the campaign's flights, bit for bit. The index numbers the flights.
    controllers
        Some of the campaign's; all by default.
    channels
        Channels to record, at the rate of the campaign's histories.

    Returns
    -------
    xarray.Dataset
        With the axes controller and flight: ``outcome``, ``end_time_s`` and each metric; the channels over time, too,
        not-a-number after a flight's end. ``attrs["units"]`` of each.

    Raises
    ------
    InputError
        If the table is invalid.
    """
    from abhv_mc.execution.in_memory import simulate_table

    path = find_input(os.fspath(campaign), "campaign")
    return simulate_table(read_campaign(path), inputs, controllers, channels)


def compare(
    a: Results | Paths,
    b: Results | Paths,
    controllers: Sequence[str] = (),
    fail_if_worse: Mapping[str, float | str] | None = None,
    output: Paths | None = None,
) -> "Comparison":
    """Compare two campaigns.

    On the same samples they are compared flight by flight, else by verdicts, shares and quantiles.

    Parameters
    ----------
    a, b
        Their results or folders.
    controllers
        Two to compare across, the first campaign's and the second's.
    fail_if_worse
        The share by which `b` may be worse in a metric, such as ``{"altitude_error_max_m": "5 %"}``.
    output
        A folder for the page.

    Returns
    -------
    Comparison
        ``.table`` is a DataFrame of differences with their intervals, ``.figure()`` the figure of the page, and
        ``.numbers()`` what ``--json`` holds.

    Raises
    ------
    InputError
        For what is wrong with a folder or an argument.
    """
    from abhv_mc.report.numbers.compare import parse_margins
    from abhv_mc.report.pages.compare_page import compare_folders

    shares = check_mapping(fail_if_worse or {}, "fail_if_worse")
    margins = parse_margins([f"{metric}={share}" for metric, share in shares.items()])
    folder_a, folder_b = (
        source.folder if isinstance(source, Results) else Path(source) for source in (a, b)
    )
    out = Path(output) if output is not None else None
    return compare_folders(folder_a, folder_b, controllers, margins, out)
