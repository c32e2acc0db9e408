"""Every metric of every controller: quantiles and the worst flight."""

from collections.abc import Iterator

from abhv_mc.topics.metrics.model import Metrics, compute_metrics
from abhv_mc.topics.metrics.section import metric_section
from abhv_mc.topics.names import Names
from abhv_mc.topics.topic import Drawn, Topic


def _figures(found: Metrics, names: Names) -> Iterator[Drawn]:
    from abhv_mc.topics.metrics.figures import metric_figures

    yield from metric_figures(found, names)


METRICS = Topic("metrics", Metrics, compute_metrics, metric_section, figures=_figures)
