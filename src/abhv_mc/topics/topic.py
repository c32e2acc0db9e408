"""Report topic with its numbers, section and figures."""

import sys
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from abhv_mc.entry_points import TOPICS, find_entry_points
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.io.input_error import InputError, found_value
from abhv_mc.topics.names import Names, names_of
from abhv_mc.topics.section import FigureText, Section

if TYPE_CHECKING:
    from matplotlib.figure import Figure

M = TypeVar("M")
# name, title and caption of a figure, and the figure
Drawn: TypeAlias = "tuple[FigureText, Figure]"


def figures_of(room: str) -> Callable[[Any, Names], Iterator[Drawn]]:
    """Return a function that makes the figures defined in a package's ``figures`` module.

    The module and matplotlib are imported on the first call.
    """

    def draw(model: Any, names: Names) -> Iterator[Drawn]:
        yield from import_module(f"{room}.figures").draw(model, names)

    return draw


@dataclass(frozen=True)
class Topic(Generic[M]):
    """Report topic whose ``compute`` returns a model, a frozen dataclass of numbers.

    The section and figures are made from the model and :class:`Names`, which also gives
    access to the campaign and its results.
    """

    # name of the topic in report.json, in `abhv-mc show NAME DIR` and in the results
    name: str
    model: type[M]
    compute: Callable[[FlownCampaign], M]
    section: Callable[[M, Names], Section | None]  # section, or None if there is nothing to report
    figures: Callable[[M, Names], Iterator[Drawn]] = lambda _model, _names: iter(())


class Models:
    """Models of a campaign's topics, each computed on first use."""

    def __init__(self, results: FlownCampaign, page: Path | None = None) -> None:
        """Prepare the models; printed commands contain the results folder relative to ``page``."""
        self.results = results
        self._page = page
        self._held: dict[str, Any] = {}

    @cached_property
    def names(self) -> Names:
        """Names of the campaign's controllers and metrics."""
        return names_of(self.results, self._page)

    def __getitem__(self, topic: Topic[M]) -> M:
        if topic.name not in self._held:
            self._held[topic.name] = topic.compute(self.results)
        model: M = self._held[topic.name]
        return model

    @cached_property
    def users(self) -> tuple["Topic[Any]", ...]:
        """Custom topics that do not fail for this campaign; failures are reported on stderr."""
        topics = []
        for topic in user_topics():
            try:
                self.section(topic)
            except Exception:
                _tell_failure(topic.name)
            else:
                topics.append(topic)
        return tuple(topics)

    def section(self, topic: Topic[Any]) -> Section | None:
        """Return a topic's section."""
        section = topic.section(self[topic], self.names)
        return section and section.without_idle()

    def figures(self, topic: Topic[Any]) -> Iterator[Drawn]:
        """Yield a topic's figures with their file names, titles and captions."""
        return topic.figures(self[topic], self.names)


REGISTERED: dict[str, Topic[Any]] = {}  # custom topics registered in this process


def user_topics() -> tuple[Topic[Any], ...]:
    """Return the custom topics of installed packages and notebooks that can be imported.

    Raise InputError for an entry point that is not a topic.
    """
    topics: dict[str, Topic[Any]] = {}
    for entry in find_entry_points(TOPICS).values():
        try:
            topic = entry.load()
        except Exception:
            _tell_failure(entry.name)
            continue
        if not isinstance(topic, Topic):
            raise InputError(
                f"entry point {entry.name} of {TOPICS}",
                found_value(topic),
                "an abhv_mc.topics.Topic",
            )
        topics[topic.name] = topic
    return tuple({**topics, **REGISTERED}.values())


def _tell_failure(name: str) -> None:
    """Report on stderr that a custom topic failed and is omitted."""
    print(
        f"the topic {name} failed and is left out of the report:\n{traceback.format_exc()}",
        end="",
        file=sys.stderr,
        flush=True,
    )
