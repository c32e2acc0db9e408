"""Results as other programs read them: a verification matrix and the metrics (CSV), and JUnit XML for pipelines."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple
from xml.etree import ElementTree

from abhv_mc.campaign.file.config import TRACED
from abhv_mc.flight.metrics import Metric
from abhv_mc.folder.manifest import RequirementVerdict
from abhv_mc.io.csv_table import csv_text
from abhv_mc.topics.metrics import Metrics
from abhv_mc.topics.plain import plain
from abhv_mc.topics.verdicts.model import Verdicts

_COLUMNS = (
    *TRACED, "metric", "above", "below", "unit", "probability", "controller", "binding", "verdict", "failures",
    "flights", "tolerance_limit", "consumer_risk", "words",
)  # fmt: skip


def make_matrix(verdicts: Verdicts, metrics: Mapping[str, Metric]) -> str:
    """A row for each requirement and controller; ``metrics`` are the records of the campaign."""
    rows: list[Sequence[object]] = [_COLUMNS]
    for entry in verdicts.requirements:
        item = entry.asked
        asked = {**item.traced, **item.limits.as_entry(), "metric": item.metric, "probability": item.probability,
                 "unit": metrics[item.metric].unit.removeprefix("-"), "consumer_risk": item.consumer_risk}  # fmt: skip
        for name, verdict in entry.controllers.items():
            found = {
                key: getattr(verdict, key)
                for key in ("failures", "flights", "tolerance_limit", "words")
            }
            binding = "yes" if name in item.controllers else "no"
            found |= {"controller": name, "binding": binding, "verdict": verdict.status}
            cells = {**asked, **found}
            rows.append([cells.get(column) for column in _COLUMNS])
    return csv_text(rows)


def make_metrics(found: Metrics) -> str:
    """A row for each metric and controller: quantiles with 95 % intervals, the worst flight."""
    rows: list[dict[str, object]] = []
    for metric, table in found.table.items():
        unit = table.words["unit"].removeprefix("-")
        for name, each in table.controllers.items():
            row: dict[str, object] = {"metric": metric, "unit": unit, "controller": name}
            for level, interval in each.quantiles.items():
                row |= {f"{level}_{end}": value for end, value in plain(interval).items()}
            rows.append({**row, "worst": each.worst, "worst_flight": each.worst_flight})
    columns = list(rows[0]) if rows else []
    return csv_text([columns, *([row.get(column) for column in columns] for row in rows)])


class Case(NamedTuple):
    """One test as a pipeline shows it."""

    name: str
    status: str  # "PASS", "FAIL", or why it is neither
    words: str


def verdict_cases(entries: Iterable[RequirementVerdict]) -> list[Case]:
    """The binding requirements, as a campaign's manifest has them."""
    cases = []
    for entry in entries:
        asked = f"{entry.asked} in {100.0 * entry.probability:g} %"
        name = " ".join(filter(None, (entry.id, asked, f"({entry.controller})")))
        cases.append(Case(name, entry.verdict, entry.words))
    return cases


def judged_cases(verdicts: Verdicts) -> list[Case]:
    """The binding requirements, as a report judges them."""
    return [
        Case(
            " ".join(
                filter(
                    None,
                    (
                        item.asked.traced.get("id"),
                        f"{item.asked.metric} {item.asked.limits}",
                        f"in {100.0 * item.asked.probability:g} % ({name})",
                    ),
                )
            ),
            verdict.status,
            verdict.words,
        )
        for item in verdicts.requirements
        for name, verdict in item.controllers.items()
        if name in item.asked.controllers
    ]


def make_junit(suite: str, cases: Iterable[Case]) -> str:
    """JUnit XML: what failed is a failure, what is neither shown nor failed is skipped."""
    listed = list(cases)
    failed = sum(case.status == "FAIL" for case in listed)
    skipped = sum(case.status not in ("PASS", "FAIL") for case in listed)
    facts = {
        "name": suite,
        "tests": str(len(listed)),
        "failures": str(failed),
        "errors": "0",
        "skipped": str(skipped),
    }
    root = ElementTree.Element("testsuites", facts)
    holder = ElementTree.SubElement(root, "testsuite", facts)
    for case in listed:
        element = ElementTree.SubElement(
            holder, "testcase", {"classname": suite, "name": case.name, "time": "0"}
        )
        if case.status == "FAIL":
            ElementTree.SubElement(element, "failure", {"message": case.words})
        elif case.status != "PASS":
            ElementTree.SubElement(element, "skipped", {"message": case.words})
        else:
            ElementTree.SubElement(element, "system-out").text = case.words
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
