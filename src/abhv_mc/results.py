"""Results of a campaign: tables, report topics, figures and re-run flights."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from abhv_mc.folder.hashes import read_checked, refuse_changes
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.messages import InputError, check_mapping, found_value, one_of, quoted
from abhv_mc.topics.formatting import count_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from abhv_mc.analysis.explain import Explanation
    from abhv_mc.campaign.file.requirement_set import RequirementSource
    from abhv_mc.folder.flown_campaign import FlownCampaign
    from abhv_mc.search.tighten import Tightening
    from abhv_mc.topics.topic import Models, Records

_AXES = {
    "histories": ("controller", "flight", "time"),
    "envelopes": ("controller", "channel", "time"),
    "nominal": ("controller", "time"),
    "reference": ("time",),
}


class Results:
    """Results of a campaign as pandas tables, in SI units and degrees.

    ``attrs["units"]`` of a table holds the units of its columns. Tables are read on first access.
    Each topic of the report is an attribute, such as ``results.margins``.

    Parameters
    ----------
    folder
        Results folder of the campaign; see :func:`abhv_mc.open_results`.
    requirements
        Requirements that replace the requirements in the folder; see :meth:`judge`.

    Attributes
    ----------
    folder
        Absolute path of the folder.
    manifest
        Content of ``manifest.json``.

    Raises
    ------
    InputError
        If the folder is damaged, or has changed since it was opened.

    Examples
    --------
    >>> results = abhv_mc.open_results("reports/study")
    >>> results.complete
    True
    >>> results.verdicts["status"].tolist()
    ['NOT SHOWN', 'NOT SHOWN']
    >>> errors = results.flights.groupby("controller")["altitude_error_max_m"].max()
    """

    def __init__(self, folder: Path, requirements: "RequirementSource | None" = None) -> None:
        self.folder = folder.absolute()
        self._requirements = requirements
        self._paths = CampaignFolder(self.folder)
        self.manifest = read_checked(self._paths)

    def _refuse_changes(self) -> None:
        refuse_changes(self._paths, self.manifest)

    @property
    def complete(self) -> bool:
        """Whether all flights have been run."""
        return self.manifest.complete

    @property
    def controllers(self) -> tuple[str, ...]:
        """Names of the simulated controllers."""
        return self._results.controllers

    @cached_property
    def flights(self) -> "pd.DataFrame":
        """Table of outcomes, dispersed values and metrics, one row per flight and controller."""
        table = self._read("flights")
        order = {name: i for i, name in enumerate(self.controllers)}
        return table.sort_values(
            ["controller", "flight"],
            key=lambda c: c.map(order) if c.name == "controller" else c,
            ignore_index=True,
        )

    @cached_property
    def samples(self) -> "pd.DataFrame":
        """Values of the dispersed parameters in each flight, in SI units."""
        return self._read("samples").set_index("flight")

    @cached_property
    def envelopes(self) -> "pd.DataFrame":
        """Time-history envelopes: extremes and quantiles, by controller and channel."""
        return self._read("envelopes")

    @cached_property
    def histories(self) -> "pd.DataFrame":
        """Time histories of the flights for which they were stored."""
        return self._read("histories")

    @cached_property
    def nominal(self) -> "pd.DataFrame":
        """Time histories of each controller's nominal flight."""
        return self._read("nominal")

    @cached_property
    def reference(self) -> "pd.DataFrame":
        """Reference trajectory of the mission over time."""
        return self._read("reference")

    @cached_property
    def numbers(self) -> dict[str, Any]:
        """Content of ``report.json``."""
        from abhv_mc.report.numbers.report_numbers import make_numbers

        numbers = make_numbers(self._models)
        self._refuse_changes()
        return numbers

    def judge(self, requirements: "RequirementSource") -> "Results":
        """Judge the stored flights against other requirements; nothing is run or written.

        Parameters
        ----------
        requirements : path, mapping or list of mappings
            A campaign file, a YAML file with ``requirements``, a CSV file of requirements, or the
            entries themselves.

        Returns
        -------
        Results
            The same flights with the verdicts, summary and figures for these requirements.

        Examples
        --------
        >>> results = abhv_mc.open_results("reports/study")
        >>> tighter = {"metric": "sideslip_max_deg", "below": 1e-9, "probability": 0.9}
        >>> results.judge([tighter]).verdicts["status"].tolist()
        ['FAIL', 'FAIL']
        """
        judged = Results(self.folder, requirements)
        judged._results  # noqa: B018  # raises InputError for requirements that do not fit
        return judged

    @property
    def summary(self) -> "Records":
        """Labelled records of verdicts, comparison, risk and next step, which print as text."""
        from abhv_mc.report.numbers.summary import summarize

        return summarize(self._models).at(self._models.names.folder)

    @property
    def verdicts(self) -> "pd.DataFrame":
        """Verdicts, counts, tolerance limits and margins, by requirement and controller."""
        import pandas as pd

        from abhv_mc.topics.verdicts import VERDICTS

        rows = [
            {"requirement": entry.name, "controller": name, "asked": entry.words, **vars(verdict)}
            for entry in self._models[VERDICTS].requirements
            for name, verdict in entry.controllers.items()
        ]
        return (
            pd.DataFrame(rows).set_index(["requirement", "controller"]) if rows else pd.DataFrame()
        )

    @property
    def quantiles(self) -> "pd.DataFrame":
        """Quantiles with 95 % confidence intervals, by metric, controller and level."""
        import pandas as pd

        from abhv_mc.topics.metrics import METRICS

        rows = [
            {"metric": metric, "controller": name, "level": level, **vars(interval)}
            for metric, entry in self._models[METRICS].table.items()
            for name, estimates in entry.controllers.items()
            for level, interval in estimates.quantiles.items()
        ]
        return pd.DataFrame(rows).set_index(["metric", "controller", "level"])

    @cached_property
    def _figures(self) -> "dict[str, Figure]":
        from abhv_mc.topics.registry import make_figures

        topic_figures = make_figures(self._models).values()
        figures = {text.name: figure for pairs in topic_figures for text, figure in pairs}
        self._refuse_changes()
        return figures

    @property
    def figure_names(self) -> tuple[str, ...]:
        """Names of the report's figures."""
        return tuple(self._figures)

    def figure(self, name: str, dpi: float = 100.0) -> "Figure":
        """Return a figure of the report. Raise KeyError for an unknown name."""
        return _on_white(self._figures[name], dpi)

    def to_xarray(
        self, table: Literal["histories", "envelopes", "nominal", "reference"] = "histories"
    ) -> "xr.Dataset":
        """Return a table over time as an xarray Dataset; requires xarray.

        Each column is a variable with ``units`` in its attrs. Histories have the axes controller,
        flight and time, and are NaN for flights without a history and after the end of a flight.
        Envelopes have the axes controller, channel and time, nominal flights controller and time,
        and the reference time. Raise InputError for other tables.
        """
        if table not in _AXES:
            raise InputError("table", found_value(table), one_of(_AXES))
        try:
            import xarray  # noqa: F401
        except ImportError:
            raise InputError("to_xarray", "xarray is not installed", "pip install xarray") from None
        rows = getattr(self, table)
        axes, units = list(_AXES[table]), rows.attrs.get("units", {})
        texts = {
            name: rows[name].astype(object) for name in ("controller", "channel") if name in rows
        }
        dataset = rows.assign(**texts).set_index(axes).to_xarray()
        for name in dataset.variables:
            if name in units:
                dataset[name].attrs["units"] = units[name]
        return dataset.assign_attrs(campaign=self.manifest.name, digest=self.manifest.digest)

    def to_geojson(self) -> dict[str, Any]:
        """Return keep-out zones and the ground tracks of stored histories as GeoJSON (RFC 7946).

        Zones have the property ``zone``; tracks, with altitudes in m, have ``controller``,
        ``flight`` and ``outcome``.
        """
        features = [
            {
                "type": "Feature",
                "properties": {"zone": name},
                "geometry": {"type": "Polygon", "coordinates": [outline[:, ::-1].tolist()]},
            }
            for name, outline in self._results.campaign.contents.zones.items()
        ]
        outcomes = self.flights.set_index(["controller", "flight"]).outcome
        for keys, rows in self.histories.groupby(["controller", "flight"], observed=True):
            track = rows[["longitude_deg", "latitude_deg", "altitude_m"]].dropna()
            names = {"controller": keys[0], "flight": int(keys[1]), "outcome": outcomes[keys]}
            features.append(
                {
                    "type": "Feature",
                    "properties": names,
                    "geometry": {"type": "LineString", "coordinates": track.to_numpy().tolist()},
                }
            )
        return {"type": "FeatureCollection", "features": features}

    def make_report(self) -> Path:
        """Write the report to the folder and return the path of the page."""
        from abhv_mc.report.pages.build import build_report

        self._refuse_changes()
        if self._requirements is not None:
            raise InputError(
                "make_report",
                "these results are judged against requirements that are not in the folder",
                "`abhv-mc report DIR --requirements FILE -o OUT`",
            )
        return build_report(self.folder)

    def query(self, sql: str) -> "pd.DataFrame":
        """Return the result of an SQL query on the tables of the folder.

        The tables are flights, samples, histories, envelopes, nominal and reference. The result is
        empty for SQL without a query. Raise InputError if the query fails.
        """
        import pandas as pd

        from abhv_mc.folder.tables import run_query

        table = run_query(self.folder, sql, lambda answer: answer.df())
        self._refuse_changes()
        return pd.DataFrame() if table is None else table

    def replay(self, flight: int, controller: str | None = None) -> "pd.DataFrame":
        """Re-run one flight and return its channels at the full sampling rate.

        The only controller under test is the default. Raise RuntimeError if any bit differs from
        the stored flight, for instance because another version of the program computed it.
        """
        import pandas as pd

        from abhv_mc.analysis.replay import replay_flight

        name = self._results.campaign.choose_controller(controller)
        again = replay_flight(self.folder, name, flight)
        self._refuse_changes()
        if again.differences:
            raise RuntimeError(
                f"flight {flight} differs from the stored flight: {'; '.join(again.differences)}"
            )
        table = pd.DataFrame(
            again.block.history[0], columns=[channel.name for channel in again.channels]
        ).dropna(how="all")
        table.insert(0, "time", again.block.times[table.index])
        return table.reset_index(drop=True)

    def explain(
        self, flight: int, controller: str | None = None, requirement: str | None = None
    ) -> "Explanation":
        """Return the smallest set of dispersions that makes a flight fail.

        The command ``abhv-mc explain`` prints the same result.
        """
        from abhv_mc.analysis.explain import explain_flight

        self._refuse_changes()
        name = self._results.campaign.choose_controller(controller)
        return explain_flight(self.folder, name, flight, requirement=requirement)

    @staticmethod
    def explained_figure(explanation: "Explanation", dpi: float = 100.0) -> "Figure":
        """Return a figure of a failed flight, one with its causes only, and the nominal flight."""
        from abhv_mc.report.pages.single_flights import make_explained_figure

        return _on_white(make_explained_figure(explanation), dpi)

    def whatif(self, settings: Mapping[str, Any]) -> "pd.DataFrame":
        """Return quantiles for the simulated dispersions and, by re-weighting, for others.

        An example of `settings` is ``{"aero.drag.half_width": "12 %"}``. The effective numbers of
        flights are in the table's ``attrs``. Raise InputError if the flights do not cover the new
        distributions.
        """
        import pandas as pd

        from abhv_mc.analysis.reweight import parse_settings
        from abhv_mc.report.numbers.whatif import make_whatif
        from abhv_mc.topics.formatting import ends_of

        pairs = check_mapping(settings, "settings").items()
        changes = parse_settings([f"{key}={value}" for key, value in pairs])
        self._refuse_changes()
        answer = make_whatif(self.folder, changes, self._requirements)
        rows = [
            {"metric": row.metric, "controller": name, "level": row.level}
            | {
                f"{when}{end}": value
                for when in ("before", "after")
                for end, value in zip(
                    ("", "_low", "_high"), ends_of(getattr(row, when)), strict=True
                )
            }
            for name, own in answer.controllers.items()
            for row in own.estimates
            if row.level != "share"
        ]
        table = pd.DataFrame(rows).set_index(["metric", "controller", "level"])
        table.attrs["effective_flights"] = {
            name: own.effective_flights for name, own in answer.controllers.items()
        }
        return table

    def tighten(
        self,
        controller: str | None = None,
        dispersions: Sequence[str] = (),
        output: Path | None = None,
    ) -> "Tightening":
        """Return the width to which each dispersion must shrink so that a controller passes.

        The command ``abhv-mc tighten`` prints the same result.
        """
        from abhv_mc.search.tighten import tighten

        self._refuse_changes()
        judged_by = self._requirements
        return tighten(self.folder, controller, dispersions, output=output, requirements=judged_by)

    @cached_property
    def _results(self) -> "FlownCampaign":
        from abhv_mc.folder.flown_campaign import read_flown

        results = read_flown(self.folder, self._requirements)
        self._refuse_changes()
        return results

    @cached_property
    def _models(self) -> "Models":
        from abhv_mc.topics.topic import Models

        return Models(self._results)

    def __getattr__(self, name: str) -> Any:
        """Return the results on a topic of the report, such as ``margins``."""
        if name.startswith("_"):
            raise AttributeError(name)
        from abhv_mc.topics.registry import all_topics

        for topic in all_topics():
            if topic.name == name:
                return self._models[topic]
        raise AttributeError(
            f"no topic '{name}'; the topics are {quoted(topic.name for topic in all_topics())}"
        )

    def _read(self, name: str) -> "pd.DataFrame":
        import pyarrow as pa
        import pyarrow.parquet as pq

        from abhv_mc.folder.tables import table_files

        tables = [
            pq.read_table(file, partitioning=None)
            for file in table_files(self._paths, self.manifest)[name]
        ]
        self._refuse_changes()
        arrow_table = pa.concat_tables(tables, promote_options="default")
        # Ignore the pandas metadata of a file, which may rename columns.
        table = arrow_table.to_pandas(ignore_metadata=True)
        units = {
            field.name: (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
            for field in arrow_table.schema
        }
        table.attrs["units"] = {name: unit for name, unit in units.items() if unit}
        return table

    def __repr__(self) -> str:
        facts = self.manifest
        return (
            f"<Results {facts.name}: {count_of(facts.runs_done, facts.runs_planned)} flights, "
            f"{facts.state}>"
        )

    def _repr_html_(self) -> str:
        """Return the outcomes and verdicts in the manifest as HTML for notebooks."""
        facts = self.manifest
        head = (
            f"{facts.name}: {count_of(facts.runs_done, facts.runs_planned)} flights of each "
            f"controller, {facts.state}"
        )
        rows = [
            (name, ", ".join(f"{n} {outcome}" for outcome, n in count.outcomes.items()), "")
            for name, count in facts.controllers.items()
        ]
        rows += [
            (entry.controller, f"{entry.asked} in {100 * entry.probability:g} %", entry.label)
            for entry in (*facts.requirements, *facts.requirements_shown)
        ]
        return as_html(head, rows)


def _on_white(figure: "Figure", dpi: float) -> "Figure":
    """Give a figure a white background, so that its text is legible in dark notebooks."""
    figure.set_dpi(dpi)
    figure.set_facecolor("white")
    return figure


def as_html(head: str, rows: Sequence[Sequence[str]]) -> str:
    """Return an HTML table of escaped text, below a line of text."""
    import pandas as pd

    return f"<p>{escape(head)}</p>{pd.DataFrame(rows).to_html(header=False, index=False)}"


def open_results(folder: str | Path) -> Results:
    """Open the results folder of a campaign.

    Parameters
    ----------
    folder
        Folder of the campaign.

    Returns
    -------
    Results
        Results with tables, verdicts, figures and re-run flights.

    Raises
    ------
    InputError
        If the folder has no results or is damaged.

    Examples
    --------
    >>> abhv_mc.open_results("reports/study")
    <Results synthetic_s: 12 of 12 flights, complete>
    """
    return Results(Path(folder))
