"""Report topic with the Spearman correlations between dispersions and required metrics."""

from collections.abc import Mapping
from dataclasses import dataclass

from scipy.stats import spearmanr

from abhv_mc.topics import Cell, FlownCampaign, Names, Section, Table, Topic


@dataclass(frozen=True)
class Correlations:
    """Rank correlations by controller, metric and parameter."""

    controllers: Mapping[str, Mapping[str, Mapping[str, float]]]


def compute(results: FlownCampaign) -> Correlations:
    """Return the correlations over all flights of each controller."""
    return Correlations(
        {name: {m: _row(results, name, m) for m in results.asked} for name in results.controllers}
    )


def _row(results: FlownCampaign, controller: str, metric: str) -> dict[str, float]:
    flights = results.flights[controller]
    sampled = {name: results.samples[name][flights.flight] for name in results.dispersed}
    return {
        name: float(spearmanr(x, flights.metrics[metric], nan_policy="omit").statistic)
        for name, x in sampled.items()
    }


def section(correlations: Correlations, names: Names) -> Section:
    """Return a table with a row for each controller and metric."""
    groups, parameters = [], ()
    for name, metrics in correlations.controllers.items():
        rows = []
        for metric, row in metrics.items():
            parameters = tuple(row)
            words = (
                names.label(name),
                names.metrics[metric].label,
                *(f"{value:+.2f}" for value in row.values()),
            )
            rows.append(tuple(map(Cell, words)))
        groups.append(tuple(rows))
    table = Table("Rank correlations", ("Controller", "Metric", *parameters), tuple(groups))
    return Section("Rank correlations", (table,))


CORRELATE = Topic("correlate", Correlations, compute, section)
