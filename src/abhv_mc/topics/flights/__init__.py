"""What each flight did, and the worst of them."""

from abhv_mc.topics.flights.model import Flights, compute_flights
from abhv_mc.topics.flights.section import flight_section, flight_sentences
from abhv_mc.topics.topic import Topic, figures_of

FLIGHTS = Topic("flights", Flights, compute_flights, flight_section, flight_sentences, figures_of(__name__))
