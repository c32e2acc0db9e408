"""The channels over all flights: bands over time, and how far each channel goes."""

from abhv_mc.topics.envelopes.model import Envelopes, compute_envelopes
from abhv_mc.topics.envelopes.section import envelope_section
from abhv_mc.topics.topic import Topic, figures_of

ENVELOPES = Topic("envelopes", Envelopes, compute_envelopes, envelope_section, figures=figures_of(__name__))
