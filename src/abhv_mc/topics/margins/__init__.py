"""How far each controller is from instability, in steady flight and over the flights."""

from collections.abc import Iterator

from abhv_mc.topics.margins.model import Margins, compute_margins
from abhv_mc.topics.margins.section import margin_section
from abhv_mc.topics.margins.sentences import margin_sentences
from abhv_mc.topics.names import Names
from abhv_mc.topics.topic import Drawn, Topic


def _figures(margins: Margins, names: Names) -> Iterator[Drawn]:
    from abhv_mc.topics.margins.figures import margin_figures

    yield from margin_figures(margins, names)


MARGINS = Topic("margins", Margins, compute_margins, margin_section, margin_sentences, _figures)
