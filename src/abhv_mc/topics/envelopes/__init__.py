"""The channels over all flights: bands over time, and how far each channel goes."""

from collections.abc import Iterator

from abhv_mc.topics.envelopes.model import Envelopes, compute_envelopes, envelope_section
from abhv_mc.topics.names import Names
from abhv_mc.topics.topic import Drawn, Topic


def _figures(found: Envelopes, names: Names) -> Iterator[Drawn]:
    from abhv_mc.topics.envelopes.channels import channel_figures

    yield from channel_figures(found, names)


ENVELOPES = Topic("envelopes", Envelopes, compute_envelopes, envelope_section, figures=_figures)
