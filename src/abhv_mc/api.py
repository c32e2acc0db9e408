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
from abhv_mc.entry_points import needs_vehicle
from abhv_mc.io.messages import InputError, InputErrors, check_mapping, grouped_digits, quoted
from abhv_mc.requests import Paths, RareRequest, Request, WorstRequest, check_count, takes
from abhv_mc.results import Results, as_html, open_results
from abhv_mc.shipped import find_input

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from abhv_mc.report.pages.compare_page import Comparison
    from abhv_mc.search.identify import Identification
    from abhv_mc.search.rare import RareFound
    from abhv_mc.search.worst import WorstFound
    from abhv_mc_vehicle.one_flight.fly_once import fly
    from abhv_mc_vehicle.one_flight.linear_models import (
        LinearModel,
        StateSpace,
        fly_on,
        linearize,
        margins,
    )
    from abhv_mc_vehicle.one_flight.plant import Plant, PlantState
    from abhv_mc_vehicle.one_flight.trim_table import trim

__all__ = [
    "Campaign",
    "InputError",
    "InputErrors",
    "LinearModel",
    "Plant",
    "PlantState",
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

_OF_VEHICLE = {  # modules of the names that the vehicle defines
    **dict.fromkeys(("fly", "write_inputs"), "fly_once"),
    "trim": "trim_table",
    **dict.fromkeys(("Plant", "PlantState"), "plant"),
    **dict.fromkeys(
        ("LinearModel", "StateSpace", "fly_on", "linearize", "margins"), "linear_models"
    ),
}


def __getattr__(name: str) -> Any:
    if name not in _OF_VEHICLE:
        raise AttributeError(f"module 'abhv_mc.api' has no attribute '{name}'")
    from importlib import import_module

    with needs_vehicle(f"abhv_mc.{name}"):
        return getattr(import_module(f"abhv_mc_vehicle.one_flight.{_OF_VEHICLE[name]}"), name)


class Campaign:
    """Validated campaign file; functions accept this object in place of a path.

    Attributes
    ----------
    path
        Absolute path of the file.
    name, question
        Name of the campaign and the question that it answers.
    runs
        Number of flights of each controller.
    controllers
        Names of the controllers; the first is compared with the others.
    parameters
        Names of the dispersed parameters.

    Examples
    --------
    >>> campaign = abhv_mc.Campaign.read("s_manoeuvre")
    >>> campaign.controllers
    ('tlc', 'lqr', 'tlc_robust', 'lqr_robust')
    >>> results = campaign.run(runs=64)  # doctest: +SKIP
    """

    def __init__(self, path: Path, checked: Experiment) -> None:
        self.path = path.absolute()  # unaffected by later changes of the working directory
        self._checked = checked
        self._origin: Campaign | None = None  # campaign whose temporary files this one uses
        self.name: str = checked.model.name
        self.question: str = checked.model.question
        self.runs = checked.runs
        self.controllers: tuple[str, ...] = checked.controllers
        self.parameters: tuple[str, ...] = checked.names

    def __fspath__(self) -> str:
        return str(self.path)

    @classmethod
    def read(cls, path: Paths) -> "Campaign":
        """Read a campaign file.

        Parameters
        ----------
        path
            Campaign file, or the name of a shipped campaign.

        Returns
        -------
        Campaign

        Raises
        ------
        InputError
            If the file is invalid; the error lists all problems.
        """
        file = find_input(os.fspath(path), "campaign")
        return cls(file, read_campaign(file))

    @classmethod
    def make(cls, data: Mapping[str, Any], **overrides: Any) -> "Campaign":
        """Create a campaign from the content of a campaign file.

        Parameters
        ----------
        data
            Content of a campaign file. Vehicle, mission and controllers are names of shipped files,
            paths or mappings (see :func:`abhv_mc.fly`). For a gain sweep, pass a dict of several
            controllers.
        overrides
            Entries that replace those of ``data``, such as ``runs=200``.

        Returns
        -------
        Campaign

        Raises
        ------
        InputError
            If the content is invalid; the error lists all problems.

        Examples
        --------
        >>> study = {
        ...     "name": "study",
        ...     "vehicle": "abhv",
        ...     "mission": "turn",
        ...     "controllers": {"tlc": "tlc", "narrow": {"base": "tlc", "limits.bank": "60 deg"}},
        ...     "dispersions": {"aero.drag": {"distribution": "uniform", "half_width": "10 %"}},
        ...     "seed": 1,
        ... }
        >>> abhv_mc.Campaign.make(study, runs=200)
        <Campaign study: 200 flights of 'tlc' and 'narrow', dispersions: 1>
        """
        folder = mkdtemp(prefix="abhv-mc-")
        try:
            write_inputs = __getattr__("write_inputs")
            path = write_inputs({**check_mapping(data, "data"), **overrides}, Path(folder))
            campaign = cls(path, read_campaign(path))
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        weakref.finalize(
            campaign, shutil.rmtree, folder, ignore_errors=True
        )  # The folder may be deleted, because results folders contain copies of its files.
        return campaign

    def vary(
        self,
        variants: Mapping[str, Any] | Sequence[Mapping[str, Any]] = (),
        **overrides: Any,
    ) -> "Campaign":
        """Return the campaign with variants of its controllers, for a study over parameters.

        Parameters
        ----------
        variants
            Values of entries in controller files, by controller and key: all combinations of the
            lists in a mapping, or a list of mappings. A number has the unit of the entry that it
            replaces.
        overrides
            Entries that replace those of the campaign, as in :meth:`make`. All controllers have the
            same vehicle and mission; a study over them needs a campaign for each value.

        Returns
        -------
        Campaign
            Campaign with the same samples, and each variant as a further controller.

        Raises
        ------
        InputError
            If the content is invalid; the error lists all problems.

        Examples
        --------
        >>> campaign = abhv_mc.Campaign.read("paper")
        >>> campaign.vary({"tlc.altitude.bandwidth": [0.02, 0.05]}).controllers
        ('tlc', 'lqr', 'tlc+altitude.bandwidth=0.02', 'tlc+altitude.bandwidth=0.05')
        >>> wider = campaign.vary(vehicle={"base": "abhv", "reference.area": "8.1 m2"})
        """
        data = {**self._checked.document.entries, "variants": variants}
        data |= self._checked.simulator.pack(lambda path, *_: str(path.absolute()), {})
        if path := self._checked.model.sampling.path:
            data["sampling"] = {"design": "file", "path": str(path.absolute())}
        campaign = self.make(data, **overrides)
        campaign._origin = self
        return campaign

    def draw_samples(self, flights: int | None = None) -> "pd.DataFrame":
        """Return the dispersed parameters of the first flights.

        Parameters
        ----------
        flights
            Number of flights; all by default.

        Returns
        -------
        pandas.DataFrame
            One row for each flight and one column for each parameter, in SI units.

        Raises
        ------
        InputError
            If the number is negative.

        Examples
        --------
        >>> abhv_mc.Campaign.read("s_manoeuvre").draw_samples(3).shape
        (3, 3)
        """
        import pandas as pd

        source = self._checked.make_samples()
        number = (
            self.runs if flights is None else min(check_count(flights, 0, "flights"), self.runs)
        )
        index = pd.RangeIndex(number, name="flight")
        return pd.DataFrame(source.draw(0, number), columns=list(source.names), index=index)

    @takes(Request, method_of="campaign")
    def run(request: Request) -> "Results":  # noqa: N805  the campaign is a field of the request
        """Run the missing flights, as ``abhv-mc run`` does, and return the results.

        Returns
        -------
        Results
            After an interrupt, completed flights are kept (``.complete`` is False) and the same
            call resumes the run.

        Raises
        ------
        InputError
            If an input is invalid.
        StorageFullError
            If the disk is full.
        """
        from abhv_mc.execution.runner import run_campaign

        return Results(run_campaign(request).folder)

    def identify(
        self,
        flights: Sequence[Paths],
        parameters: Sequence[str] = (),
        controller: str | None = None,
        measured: Mapping[str, float] | None = None,
        output: Paths | None = None,
    ) -> "Identification":
        """Estimate dispersions from test flights, as ``abhv-mc identify`` does.

        Parameters
        ----------
        flights
            Files of test flights: histories, or tables with a row for each flight.
        parameters
            Parameters to estimate; by default, the dispersions that vary by vehicle.
        controller
            Controller of the test flights; by default, the only one under test.
        measured
            Standard deviation of the measurement error of each channel or metric, in its unit.
        output
            Campaign file to write, with the renewed dispersions.

        Returns
        -------
        Identification
            ``.parameters`` holds the estimates, ``.dispersions`` the renewed dispersions, and
            ``.fits`` is False if the model does not fit.

        Raises
        ------
        InputError
            If a file or an argument is invalid.
        """
        from abhv_mc.search.identify import identify

        files, out = [Path(file) for file in flights], None if output is None else Path(output)
        return identify(self.path, files, parameters, controller, measured, output=out)

    def _repr_html_(self) -> str:
        """Return the campaign's question, controllers and dispersions as HTML for notebooks."""
        head = (
            f"{self.name}: {grouped_digits(self.runs)} flights of each controller. {self.question}"
        )
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
            f"<Campaign {self.name}: {grouped_digits(self.runs)} flights of "
            f"{quoted(self.controllers)}, dispersions: {len(self.parameters)}>"
        )


@takes(WorstRequest)
def worst(request: WorstRequest) -> "WorstFound":
    """Search the dispersions for the worst value of a metric, as ``abhv-mc worst`` does.

    Returns
    -------
    WorstFound
        ``.numbers()`` returns the numbers that the command writes with ``--json``.

    Raises
    ------
    InputError
        If a file or an argument is invalid.

    Examples
    --------
    >>> result = abhv_mc.worst(
    ...     "s_manoeuvre", "reports/worst", "altitude_error_max_m", flights=500
    ... )  # doctest: +SKIP
    """
    from abhv_mc.report.pages.page import write_answer
    from abhv_mc.report.pages.search_pages import make_worst_answer
    from abhv_mc.search.worst import find_worst

    result, folder = find_worst(request), Path(request.output)
    write_answer(make_worst_answer(result, folder), folder / "report.html")
    return result


@takes(RareRequest)
def rare(request: RareRequest) -> "RareFound":
    """Estimate the probability that a flight violates a requirement, as ``abhv-mc rare`` does.

    Returns
    -------
    RareFound
        ``.numbers()`` returns the numbers that the command writes with ``--json``. The probability
        is None if repetitions contradict each other or the surrogate does not converge;
        ``.estimate.refusal`` gives the reason.

    Raises
    ------
    InputError
        If a file or an argument is invalid.

    Examples
    --------
    >>> result = abhv_mc.rare(
    ...     "s_manoeuvre", "reports/rare", "altitude_error_max_m"
    ... )  # doctest: +SKIP
    >>> result.estimate.probability  # doctest: +SKIP
    """
    from abhv_mc.report.pages.page import write_answer
    from abhv_mc.report.pages.search_pages import make_rare_answer
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

    The function writes no files. It needs the optional dependency ``xarray``.

    Parameters
    ----------
    campaign
        Campaign with the vehicle, mission, controllers and metrics.
    inputs
        One row for each flight and one column for each parameter, in SI units; parameters without a
        column are nominal. The index contains the flight numbers. The rows of
        :meth:`Campaign.draw_samples` reproduce the flights of the campaign bit for bit.
    controllers
        Controllers of the campaign; all by default.
    channels
        Channels to record, at the rate of the campaign's histories.

    Returns
    -------
    xarray.Dataset
        ``outcome``, ``end_time_s`` and each metric by controller and flight, and channels by
        controller, flight and time (NaN after the end of a flight). ``attrs["units"]`` of a
        variable is its unit.

    Raises
    ------
    InputError
        If the table is invalid.

    Examples
    --------
    >>> campaign = abhv_mc.Campaign.read("s_manoeuvre")
    >>> dataset = abhv_mc.simulate(
    ...     campaign, campaign.draw_samples(8), ["tlc"], ["bank_deg"]
    ... )  # doctest: +SKIP
    """
    from abhv_mc.execution.executor import simulate_table

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

    Campaigns with the same samples are compared flight by flight, all other campaigns by verdicts,
    failure shares and quantiles.

    Parameters
    ----------
    a, b
        Results, or results folders of campaigns.
    controllers
        Two names: a controller of the first campaign, and the controller of the second campaign
        with which it is compared. By default, controllers with the same name are compared.
    fail_if_worse
        For each metric, the share by which `b` may be worse than `a`, such as
        ``{"altitude_error_max_m": "5 %"}``.
    output
        Folder for the page; by default no page is written.

    Returns
    -------
    Comparison
        ``.table`` is a DataFrame of differences with intervals, ``.figure()`` the figure of the
        page, and ``.numbers()`` returns the numbers that the command writes with ``--json``.

    Raises
    ------
    InputError
        If a folder or an argument is invalid.

    Examples
    --------
    >>> comparison = abhv_mc.compare("reports/study", "reports/study", ("tlc", "lqr"))
    >>> table = comparison.table.set_index(["metric", "quantity"])
    >>> float(table.loc[("sideslip_max_deg", "median over flights"), "difference"]) < 0.0
    True
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
