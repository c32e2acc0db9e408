"""Which failures in flight each controller survives."""

from collections.abc import Iterator

from abhv_mc.topics.failure_cases.model import FailureCases, compute_failure_cases
from abhv_mc.topics.failure_cases.section import failure_case_section, failure_case_sentences
from abhv_mc.topics.names import Names
from abhv_mc.topics.topic import Drawn, Topic


def _figures(found: FailureCases, names: Names) -> Iterator[Drawn]:
    from abhv_mc.topics.failure_cases.figures import failure_case_figures

    yield from failure_case_figures(found, names)


FAILURE_CASES = Topic(
    "failure_cases", FailureCases, compute_failure_cases, failure_case_section, failure_case_sentences, _figures
)
