"""Why flights fail: the regions of the dispersions that failures prefer."""

from abhv_mc.topics.failures.model import Failures, compute_failures
from abhv_mc.topics.failures.section import failure_section
from abhv_mc.topics.topic import Topic

FAILURES = Topic("failures", Failures, compute_failures, failure_section)
