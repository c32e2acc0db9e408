"""Whether each requirement is met, on each controller and jointly."""

from abhv_mc.topics.topic import Topic
from abhv_mc.topics.verdicts.model import Verdicts, compute_verdicts
from abhv_mc.topics.verdicts.section import verdict_section, verdict_sentences

VERDICTS = Topic("verdicts", Verdicts, compute_verdicts, verdict_section, verdict_sentences)
