"""What moves each error: rank coefficients, and indices where the relation is not monotonic."""

from abhv_mc.topics.drivers.model import Drivers, compute_drivers
from abhv_mc.topics.drivers.section import driver_section, driver_sentences
from abhv_mc.topics.topic import Topic

DRIVERS = Topic("drivers", Drivers, compute_drivers, driver_section, driver_sentences)
