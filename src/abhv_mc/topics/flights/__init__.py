"""What each flight did, and the worst of them."""

from collections.abc import Iterator

from abhv_mc.topics.flights.model import Flights, compute_flights
from abhv_mc.topics.flights.section import flight_section
from abhv_mc.topics.names import Names
from abhv_mc.topics.topic import Drawn, Topic


def _figures(found: Flights, names: Names) -> Iterator[Drawn]:
    from abhv_mc.topics.flights.figures import flight_figures

    yield from flight_figures(found, names)


FLIGHTS = Topic("flights", Flights, compute_flights, flight_section, figures=_figures)
