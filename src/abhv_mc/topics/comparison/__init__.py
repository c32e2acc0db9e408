"""The first controller against each other one, flight by flight."""

from collections.abc import Iterator

from abhv_mc.topics.comparison.model import Comparison, compute_comparison
from abhv_mc.topics.comparison.section import comparison_section
from abhv_mc.topics.comparison.sentences import comparison_sentences
from abhv_mc.topics.names import Names
from abhv_mc.topics.topic import Drawn, Topic


def _figures(found: Comparison, names: Names) -> Iterator[Drawn]:
    from abhv_mc.topics.comparison.figures import comparison_figures

    yield from comparison_figures(found, names)


COMPARISON = Topic("comparison", Comparison, compute_comparison, comparison_section, comparison_sentences, _figures)
