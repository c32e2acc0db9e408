"""Which failures in flight each controller survives."""

from abhv_mc.topics.failure_cases.model import FailureCases, compute_failure_cases
from abhv_mc.topics.failure_cases.section import failure_case_section, failure_case_sentences
from abhv_mc.topics.topic import Topic, figures_of

FAILURE_CASES = Topic(
    "failure_cases",
    FailureCases,
    compute_failure_cases,
    failure_case_section,
    failure_case_sentences,
    figures_of(__name__),
)
