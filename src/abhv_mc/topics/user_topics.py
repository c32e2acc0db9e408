"""The topics that users add: whether a report is up to date is asked without loading those of the program."""

from importlib.metadata import entry_points
from typing import Any

from abhv_mc.io.input_error import InputError, describe
from abhv_mc.topics.topic import Topic

GROUP = "abhv_mc.topics"  # of entry points: name = "package.module:TOPIC"
REGISTERED: dict[str, Topic[Any]] = {}  # in this process


def user_topics() -> tuple[Topic[Any], ...]:
    """Those that installed packages and notebooks have added. Raises InputError for an entry point that is none."""
    found: dict[str, Topic[Any]] = {}
    for entry in entry_points(group=GROUP):
        topic = entry.load()
        if not isinstance(topic, Topic):
            raise InputError(f"entry point {entry.name} of {GROUP}", describe(topic), "an abhv_mc.topics.Topic")
        found[topic.name] = topic
    return tuple({**found, **REGISTERED}.values())
