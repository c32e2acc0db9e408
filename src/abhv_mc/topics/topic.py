"""What a topic is: a question about a campaign, answered once for the page, JSON, the terminal and Python."""

import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from abhv_mc.entry_points import TOPICS, find_entry_points
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.io.input_error import InputError, describe
from abhv_mc.topics.names import Names, names_of
from abhv_mc.topics.section import FigureText, Section

if TYPE_CHECKING:
    from matplotlib.figure import Figure

M = TypeVar("M")
Drawn: TypeAlias = "tuple[FigureText, Figure]"  # a figure and its words


def figures_of(room: str) -> Callable[[Any, Names], Iterator[Drawn]]:
    """What a room's ``figures.draw`` gives: that module, and matplotlib, is imported when they are drawn."""

    def draw(model: Any, names: Names) -> Iterator[Drawn]:
        yield from import_module(f"{room}.figures").draw(model, names)

    return draw


@dataclass(frozen=True)
class Topic(Generic[M]):
    """One topic: ``compute`` makes its model, a frozen dataclass of numbers; all else is made of that alone.

    A field of the model with ``metadata={DRAWN: True}`` (:mod:`abhv_mc.topics.plain`) serves figures and stands in no
    JSON.
    """

    name: str  # of its numbers in report.json, of `abhv-mc show NAME DIR`, of an attribute of the results
    model: type[M]
    compute: Callable[[FlownCampaign], M]
    section: Callable[[M, Names], Section | None]  # None where there is nothing to say
    sentences: Callable[[M, Names], Sequence[str]] = (
        lambda _model, _names: ()
    )  # the answer in words
    figures: Callable[[M, Names], Iterator[Drawn]] = lambda _model, _names: iter(())


class Models:
    """The models of a campaign's topics, each computed when it is first asked for."""

    def __init__(self, results: FlownCampaign, page: Path | None = None) -> None:
        """``page``: the folder of the page that they are shown on, to which its commands are relative."""
        self.results = results
        self._page = page
        self._held: dict[str, Any] = {}

    @cached_property
    def names(self) -> Names:
        """What the campaign calls its controllers and metrics."""
        return names_of(self.results, self._page)

    def __getitem__(self, topic: Topic[M]) -> M:
        if topic.name not in self._held:
            self._held[topic.name] = topic.compute(self.results)
        found: M = self._held[topic.name]
        return found

    @cached_property
    def users(self) -> tuple["Topic[Any]", ...]:
        """The users' topics, less those that cannot be made of this campaign: standard error says which and why."""
        return tuple(topic for topic in user_topics() if self._can_be_made(topic))

    def _can_be_made(self, topic: Topic[Any]) -> bool:
        try:
            self.section(topic)
            self.sentences(topic)
        except Exception:
            _tell_failure(topic.name)
            return False
        return True

    def section(self, topic: Topic[Any]) -> Section | None:
        """A topic's section."""
        section = topic.section(self[topic], self.names)
        return section and section.without_idle()

    def sentences(self, topic: Topic[Any]) -> Sequence[str]:
        """A topic's answer in words."""
        return topic.sentences(self[topic], self.names)

    def figures(self, topic: Topic[Any]) -> Iterator[Drawn]:
        """A topic's figures, each with its words."""
        return topic.figures(self[topic], self.names)


REGISTERED: dict[str, Topic[Any]] = {}  # in this process


def user_topics() -> tuple[Topic[Any], ...]:
    """Those that installed packages and notebooks have added, less those whose import fails.

    Raises InputError for an entry point that is none.
    """
    found: dict[str, Topic[Any]] = {}
    for entry in find_entry_points(TOPICS).values():
        try:
            topic = entry.load()
        except Exception:
            _tell_failure(entry.name)
            continue
        if not isinstance(topic, Topic):
            raise InputError(
                f"entry point {entry.name} of {TOPICS}", describe(topic), "an abhv_mc.topics.Topic"
            )
        found[topic.name] = topic
    return tuple({**found, **REGISTERED}.values())


def _tell_failure(name: str) -> None:
    """Of a user's topic, which what is made goes on without."""
    print(
        f"the topic {name} is left out:\n{traceback.format_exc()}",
        end="",
        file=sys.stderr,
        flush=True,
    )
