"""Every metric of every controller: quantiles and the worst flight."""

from abhv_mc.topics.metrics.model import Metrics, compute_metrics
from abhv_mc.topics.metrics.section import metric_section
from abhv_mc.topics.topic import Topic, figures_of

METRICS = Topic("metrics", Metrics, compute_metrics, metric_section, figures=figures_of(__name__))
