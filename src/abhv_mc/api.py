"""All that is public: campaigns, results, flights, trims, linear models, searches and comparisons.

``abhv_mc`` has these names too; what is heavy is imported where it is used.
"""

import shutil
import weakref
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, Literal

from abhv_mc.campaign import MOST_WORKERS
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.io.documents import InputError, InputErrors, describe
from abhv_mc.io.units import FRACTION
from abhv_mc.one_flight.fly_once import fly
from abhv_mc.one_flight.given import check_count, check_mapping, to_si, write_inputs
from abhv_mc.one_flight.linear_models import LinearModel, StateSpace, fly_on, linearize, margins
from abhv_mc.one_flight.trim_table import trim
from abhv_mc.results import Results, as_html, open_results
from abhv_mc.shipped import find_input

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from abhv_mc.search.rare import RareFound
    from abhv_mc.search.search_flights import SearchRequest
    from abhv_mc.search.tune import TuneFound
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
    "tune",
    "worst",
]

Paths = str | Path


class Campaign:
    """A campaign file, read and checked; :meth:`run` flies it."""

    def __init__(self, path: Path, checked: Experiment) -> None:
        self.path, self._checked = (
            path.absolute(),
            checked,
        )  # whoever changes the working folder means no other
        self.name: str = checked.model.name
        self.question: str = checked.model.question  # what it asks
        self.runs: int = checked.runs  # flights of each controller
        self.controllers: tuple[str, ...] = (
            checked.controllers
        )  # the first is compared with the others
        self.parameters: tuple[str, ...] = checked.names  # that are dispersed

    @classmethod
    def read(cls, path: Paths) -> "Campaign":
        """Read a campaign file. Raises InputError with everything that is wrong."""
        return cls(Path(path), read_campaign(path))

    @classmethod
    def make(cls, data: Mapping[str, Any], **overrides: Any) -> "Campaign":
        """A campaign from its file's content: ``Campaign.make({"name": "study", "mission": "turn", ...})``.

        Vehicle, mission and controllers are shipped names, paths or mappings, with ``base`` and the entries that differ
        (see :func:`abhv_mc.fly`): so a gain sweep is a dict of controllers. ``overrides`` replace entries, such as
        ``runs=200``. Raises InputError with everything that is wrong.
        """
        place = mkdtemp(prefix="abhv-mc-")
        try:
            path = write_inputs({**check_mapping(data, "data"), **overrides}, Path(place))
            made = cls(path, read_campaign(path))
        except BaseException:
            shutil.rmtree(place, ignore_errors=True)
            raise
        weakref.finalize(
            made, shutil.rmtree, place, ignore_errors=True
        )  # a flown campaign has copies in its folder
        return made

    def draw_samples(self, flights: int | None = None) -> "pd.DataFrame":
        """The dispersions that the first flights will have (all by default), SI, one column a parameter."""
        import pandas as pd

        source = self._checked.make_samples()
        number = (
            self.runs if flights is None else min(check_count(flights, 0, "flights"), self.runs)
        )
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
    ) -> "Results":
        """Fly it, or what its folder misses of it, as ``abhv-mc run`` does, and open the results.

        Parameters
        ----------
        output
            ``reports/<name>`` by default; ``fresh`` deletes what it holds first.
        runs, seed, controllers, workers
            In the place of the file's.

        Returns
        -------
        Results
            An interrupt keeps what was flown (``.complete`` is False); the same call goes on.

        Raises
        ------
        InputError
            For what is wrong; StorageFullError on a full disk.
        """
        from abhv_mc.execution.runner import run_campaign
        from abhv_mc.execution.setup import Request

        names = tuple(controllers) if controllers is not None else None
        if workers is not None:
            workers = check_count(workers, 1, "workers", MOST_WORKERS)
        out = Path(output) if output is not None else None
        return Results(
            run_campaign(Request(self.path, out, runs, seed, names, workers, fresh)).folder
        )

    def _repr_html_(self) -> str:
        """What a notebook shows: what it asks, who flies, and what is dispersed."""
        head = f"{self.name}: {self.runs} flights each. {self.question}"
        data: Any = self._checked.document.data
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


Searched = Campaign | Paths  # read already, or a campaign file, or the name of a shipped one


def worst(
    campaign: Searched,
    output: Paths,
    metric: str,
    controller: str | None = None,
    bad: Literal["high", "low"] | None = None,
    flights: int = 2000,
    box: float = 3.0,
    seed: int | None = None,
    workers: int | None = None,
    fresh: bool = False,
    scheduler: str | None = None,
) -> "WorstFound":
    """Search the box of a campaign's dispersions for the worst value of a metric, as ``abhv-mc worst`` does.

    Parameters
    ----------
    campaign
        A :class:`Campaign`, a campaign file, or the name of a shipped one.
    output
        The folder of flights and ``report.html``; ``fresh`` deletes what it holds of a campaign first.
    metric, controller, flights, seed, workers, scheduler
        As the command's options; ``controller`` is the campaign's first by default.
    bad
        Which values are bad; those that the campaign takes for bad by default.
    box
        In sigma, of unbounded distributions.

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
    from abhv_mc.search.worst import WorstSettings, find_worst

    if bad not in ("high", "low", None):
        raise InputError("bad", describe(bad), "'high', 'low' or None")
    settings = WorstSettings(
        metric, bad, check_count(flights, 1, "flights"), _between("box", float(box), 0.1, 8.0)
    )
    found = find_worst(
        _request(campaign, output, controller, seed, workers, scheduler, fresh), settings
    )
    write_answer(make_worst_answer(found, Path(output)), Path(output) / "report.html")
    return found


def rare(
    campaign: Searched,
    output: Paths,
    requirement: str,
    controller: str | None = None,
    target_cov: float | str = "20 %",
    flights: int = 20_000,
    seed: int | None = None,
    workers: int | None = None,
    fresh: bool = False,
    scheduler: str | None = None,
) -> "RareFound":
    """Estimate how probable it is that a flight breaks the requirement on a metric, as ``abhv-mc rare`` does.

    Parameters
    ----------
    campaign, output, controller, flights, seed, workers, fresh, scheduler
        As of :func:`worst`.
    requirement
        Its metric.
    target_cov
        The coefficient of variation to reach.

    Returns
    -------
    RareFound
        ``.numbers()`` is what ``--json`` holds: its probability is None where repetitions contradict each other
        (``.estimate.refusal`` says how).

    Raises
    ------
    InputError
        For what is wrong with a file or an argument.
    """
    from abhv_mc.report.pages.page import write_answer
    from abhv_mc.report.pages.rare_page import make_rare_answer
    from abhv_mc.search.rare import RareSettings, find_rare

    cov = _between("target_cov", to_si(target_cov, FRACTION, "target_cov"), 0.01, 1.0)
    settings = RareSettings(requirement, cov, check_count(flights, 1, "flights"))
    found = find_rare(
        _request(campaign, output, controller, seed, workers, scheduler, fresh), settings
    )
    write_answer(make_rare_answer(found, Path(output)), Path(output) / "report.html")
    return found


def tune(
    campaign: Searched,
    output: Paths,
    controller: str | None = None,
    block: Paths | None = None,
    seed: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    tell: "Callable[[TuneFound], None] | None" = None,
) -> "TuneFound":
    """Tune the free numbers of a controller, as ``abhv-mc tune`` does.

    Parameters
    ----------
    campaign, controller, seed, workers, scheduler
        As of :func:`worst`.
    output
        The new controller's file, written where the result is ``.shown`` to be better within all limits; a page lies
        beside it.
    block
        A file with the entry ``tune``; the campaign by default.
    tell
        Called with the result before the new file is there, with which the same call would not run again.

    Returns
    -------
    TuneFound
        ``.as_json()`` is what ``--json`` holds.

    Raises
    ------
    InputError
        For what is wrong with a file or an argument.
    """
    from abhv_mc.report.pages.page import write_answer
    from abhv_mc.report.pages.tune_page import make_tune_answer
    from abhv_mc.search.tune import TuneRequest, tune_controller

    out = Path(output)
    given = Path(block) if block else None

    def finish(found: "TuneFound") -> None:
        if tell is not None:
            tell(found)
        write_answer(
            make_tune_answer(found),
            out.with_suffix(".html"),
            out.with_suffix(".tuning") / "figures",
        )

    return tune_controller(
        TuneRequest(_path(campaign), out, controller, given, seed, workers, scheduler), tell=finish
    )


def simulate(
    campaign: Campaign | Paths,
    inputs: "pd.DataFrame",
    controllers: Sequence[str] | None = None,
    channels: Sequence[str] = (),
) -> "xr.Dataset":
    """Fly a table of inputs with a campaign's controllers, in memory: nothing is written (needs the extra ``xarray``).

    Parameters
    ----------
    campaign
        Whose vehicle, mission, controllers and metrics fly.
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
        For a table that cannot fly.
    """
    from abhv_mc.execution.in_memory import simulate_table

    return simulate_table(read_campaign(_path(campaign)), inputs, controllers, channels)


def compare(
    a: Results | Paths,
    b: Results | Paths,
    controllers: Sequence[str] = (),
    fail_if_worse: Mapping[str, float | str] | None = None,
    output: Paths | None = None,
) -> dict[str, Any]:
    """Compare two campaigns on the same samples flight by flight.

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
    dict
        The numbers of ``abhv-mc compare --json``.

    Raises
    ------
    InputError
        For what is wrong with a folder or an argument.
    """
    from abhv_mc.report.numbers.compare import parse_margins
    from abhv_mc.report.pages.compare_page import compare_folders
    from abhv_mc.topics.plain import plain

    shares = check_mapping(fail_if_worse or {}, "fail_if_worse")
    margins = parse_margins([f"{metric}={share}" for metric, share in shares.items()])
    one, other = (each.folder if isinstance(each, Results) else Path(each) for each in (a, b))
    compared = compare_folders(
        one, other, controllers, margins, Path(output) if output is not None else None
    )
    numbers: dict[str, Any] = plain(compared.found)
    return numbers


def _path(campaign: Searched) -> Path:
    return (
        campaign.path if isinstance(campaign, Campaign) else find_input(str(campaign), "campaign")
    )


def _request(campaign: Searched, output: Paths, *more: Any) -> "SearchRequest":
    from abhv_mc.search.search_flights import SearchRequest

    return SearchRequest(_path(campaign), Path(output), *more)


def _between(name: str, value: float, low: float, high: float) -> float:
    if not low <= value <= high:
        raise InputError(name, f"{value:g}", f"a number from {low:g} to {high:g}")
    return value
