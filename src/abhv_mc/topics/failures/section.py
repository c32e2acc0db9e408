"""The report's section on where failures live."""

from abhv_mc.topics.failures.model import FailureKind, Failures
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import Bullets, Heading, Item, Section, Text
from abhv_mc.topics.words import fixed, percent

_LISTED = 5  # rules of a kind


def failure_section(failures: Failures, names: Names) -> Section:
    """The rules of every kind of failure."""
    items: list[Item] = []
    for name, kinds in failures.controllers.items():
        if kinds:
            sentences = [words for kind in kinds for words in _sentences(kind, failures.fewest_failures)]
            items += [Heading(names.label(name)), Bullets(tuple(sentences))]
    if not items:
        return Section("Where failures live", (Text("No flight failed."),))
    command = (
        f"`abhv-mc explain {names.folder} --all` finds for the failed flights the smallest sets of dispersions that "
    )
    rate = percent(failures.false_discovery_rate, 1)
    note = (
        f"Rules of one parameter or two at deciles of the samples, tested exactly, at a false-discovery rate of {rate}"
    )
    notes = Text(f"{command}with which they still fail; this page then shows them."), Text(f"{note}.")
    return Section("Where failures live", (*items, *notes))


def _sentences(kind: FailureKind, fewest: int) -> list[str]:
    head = (
        f"{kind.kind[0].upper()}{kind.kind[1:]} ({fixed(kind.failures, 0)} flight{'s' if kind.failures != 1 else ''})"
    )
    if kind.rules:
        return [f"{head}: {rule.rule}" for rule in kind.rules[:_LISTED]]
    if kind.failures == kind.flights:
        return [f"{head}: every flight."]
    few = " (too few to tell)" if kind.failures < fewest else ""
    return [f"{head}: no region holds more of them than chance explains{few}."]
