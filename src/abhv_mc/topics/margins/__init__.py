"""How far each controller is from instability, in steady flight and over the flights."""

from abhv_mc.topics.margins.model import Margins, compute_margins
from abhv_mc.topics.margins.section import margin_section, margin_sentences
from abhv_mc.topics.topic import Topic, figures_of

MARGINS = Topic("margins", Margins, compute_margins, margin_section, margin_sentences, figures_of(__name__))
