"""The first controller against each other one, flight by flight."""

from abhv_mc.topics.comparison.model import Comparison, compute_comparison
from abhv_mc.topics.comparison.section import comparison_section
from abhv_mc.topics.comparison.sentences import comparison_sentences
from abhv_mc.topics.topic import Topic, figures_of

COMPARISON = Topic(
    "comparison", Comparison, compute_comparison, comparison_section, comparison_sentences, figures_of(__name__)
)
