"""All figures of a report, each with its words."""

from collections.abc import Iterator

from abhv_mc.topics.registry import all_topics
from abhv_mc.topics.topic import Drawn, Models


def make_figures(models: Models) -> dict[str, Iterator[Drawn]]:
    """Every figure that the campaign's folder has the data for, by its topic."""
    return {topic.name: models.figures(topic) for topic in all_topics()}
