"""What moves the errors: rank coefficients of the dispersed parameters."""

from abhv_mc.topics.drivers.model import Drivers, compute_drivers
from abhv_mc.topics.drivers.section import driver_section, driver_sentences
from abhv_mc.topics.topic import Topic, figures_of

DRIVERS = Topic("drivers", Drivers, compute_drivers, driver_section, driver_sentences, figures_of(__name__))
