"""Results for other programs: requirements and metrics as CSV, verdicts as JUnit XML."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple
from xml.etree import ElementTree

from abhv_mc.campaign.file.config import TRACED
from abhv_mc.flights.metrics import Metric
from abhv_mc.folder.manifest import RequirementVerdict
from abhv_mc.io.csv_table import csv_text
from abhv_mc.topics.formatting import json_data
from abhv_mc.topics.metrics import Metrics
from abhv_mc.topics.verdicts.model import Verdicts

_COLUMNS = (
    *TRACED, "metric", "above", "below", "unit", "probability", "controller", "binding", "verdict",
    "failures", "flights", "tolerance_limit", "consumer_risk", "words",
)  # fmt: skip


def make_matrix(verdicts: Verdicts, metrics: Mapping[str, Metric]) -> str:
    """Return the verification matrix as CSV, one row per requirement and controller."""
    rows: list[Sequence[object]] = [_COLUMNS]
    for entry in verdicts.requirements:
        item = entry.asked
        fields = {
            **item.traced,
            **item.limits.as_entry(),
            "metric": item.metric,
            "probability": item.probability,
            "unit": metrics[item.metric].unit.removeprefix("-"),
        }
        for name, verdict in entry.controllers.items():
            cells = {
                **fields,
                **vars(verdict),
                "consumer_risk": item.consumer_risk,
                "controller": name,
                "binding": "yes" if name in item.controllers else "no",
                "verdict": verdict.status,
            }
            rows.append([cells.get(column) for column in _COLUMNS])
    return csv_text(rows)


def make_metrics(metrics: Metrics) -> str:
    """Return quantiles and worst flights as CSV, one row per metric and controller."""
    rows: list[dict[str, object]] = []
    for metric, table in metrics.table.items():
        unit = table.words["unit"].removeprefix("-")
        for name, estimates in table.controllers.items():
            row: dict[str, object] = {"metric": metric, "unit": unit, "controller": name}
            for level, interval in estimates.quantiles.items():
                row |= {f"{level}_{end}": value for end, value in json_data(interval).items()}
            rows.append({**row, "worst": estimates.worst, "worst_flight": estimates.worst_flight})
    columns = list(rows[0]) if rows else []
    return csv_text([columns, *([row.get(column) for column in columns] for row in rows)])


class Case(NamedTuple):
    """Test case of a JUnit file."""

    name: str
    status: str  # "PASS", "FAIL", or the reason why the verdict is neither
    words: str


def verdict_cases(entries: Iterable[RequirementVerdict]) -> list[Case]:
    """Return the binding requirements of a campaign's manifest as test cases."""
    cases = []
    for entry in entries:
        requirement = f"{entry.asked} in {100.0 * entry.probability:g} %"
        name = " ".join(filter(None, (entry.id, requirement, f"({entry.controller})")))
        cases.append(Case(name, entry.verdict, entry.words))
    return cases


def judged_cases(verdicts: Verdicts) -> list[Case]:
    """Return the binding requirements of a report's verdicts as test cases."""
    cases = []
    for item, name, verdict in verdicts.binding:
        if verdict:
            asked = item.asked
            words = f"{asked.metric} {asked.limits} in {100.0 * asked.probability:g} % ({name})"
            cases.append(
                Case(f"{asked.traced.get('id', '')} {words}".strip(), verdict.status, verdict.words)
            )
    return cases


def make_junit(suite: str, cases: Iterable[Case]) -> str:
    """Return test cases as JUnit XML; cases that neither passed nor failed are skipped."""
    listed = list(cases)
    failed = sum(case.status == "FAIL" for case in listed)
    skipped = sum(case.status not in ("PASS", "FAIL") for case in listed)
    counts = {"tests": len(listed), "failures": failed, "errors": 0, "skipped": skipped}
    facts = {"name": suite} | {key: str(count) for key, count in counts.items()}
    root = ElementTree.Element("testsuites", facts)
    holder = ElementTree.SubElement(root, "testsuite", facts)
    for case in listed:
        attributes = {"classname": suite, "name": case.name, "time": "0"}
        element = ElementTree.SubElement(holder, "testcase", attributes)
        if case.status == "FAIL":
            ElementTree.SubElement(element, "failure", {"message": case.words})
        elif case.status != "PASS":
            ElementTree.SubElement(element, "skipped", {"message": case.words})
        else:
            ElementTree.SubElement(element, "system-out").text = case.words
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
