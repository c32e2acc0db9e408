"""Registry of report topics: built in, from installed packages, or defined in a notebook."""

from collections.abc import Iterator, Sequence
from typing import Any

from abhv_mc.io.messages import InputError, found_value, one_of
from abhv_mc.topics.comparison import COMPARISON
from abhv_mc.topics.convergence import CONVERGENCE
from abhv_mc.topics.drivers import DRIVERS
from abhv_mc.topics.envelopes import ENVELOPES
from abhv_mc.topics.failure_cases import FAILURE_CASES
from abhv_mc.topics.failures import FAILURES
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.margins import MARGINS
from abhv_mc.topics.metrics import METRICS
from abhv_mc.topics.provenance import PROVENANCE
from abhv_mc.topics.simulator import SIMULATOR
from abhv_mc.topics.topic import REGISTERED, Drawn, Models, Topic, user_topics
from abhv_mc.topics.verdicts import VERDICTS

BUILT_IN: tuple[Topic[Any], ...] = (
    VERDICTS, COMPARISON, METRICS, FLIGHTS, FAILURE_CASES, FAILURES, DRIVERS, ENVELOPES, MARGINS,
    SIMULATOR, CONVERGENCE, PROVENANCE,
)  # fmt: skip


def register(topic: Topic[Any]) -> None:
    """Add a custom topic to the reports that this process makes.

    Raise InputError for an invalid name.
    """
    if not topic.name.isidentifier():
        raise InputError("topic", found_value(topic.name), "a valid Python name")
    if topic.name in {built_in.name for built_in in BUILT_IN}:
        raise InputError("topic", f"'{topic.name}' is a built-in topic", "another name")
    REGISTERED[topic.name] = topic


def all_topics(users: Sequence[Topic[Any]] | None = None) -> tuple[Topic[Any], ...]:
    """Return all topics in the order of the page, with confidence and provenance last.

    ``users`` contains custom topics, by default all that are installed or registered.
    """
    *first, confidence, provenance = BUILT_IN
    return (*first, *(user_topics() if users is None else users), confidence, provenance)


def make_figures(models: Models) -> dict[str, Iterator[Drawn]]:
    """Return iterators over the figures of each topic for which the campaign has data."""
    return {topic.name: models.figures(topic) for topic in all_topics(models.users)}


def find_topic(name: str) -> Topic[Any]:
    """Return the topic with the given name. Raise InputError if the name is unknown."""
    topics = {topic.name: topic for topic in all_topics()}
    if name not in topics:
        raise InputError("topic", found_value(name), one_of(topics, name))
    return topics[name]
