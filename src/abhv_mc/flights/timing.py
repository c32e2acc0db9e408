"""Control ticks and integration steps of a flight."""

from typing import NamedTuple


class Timing(NamedTuple):
    """Timing of a flight with control ticks 0..ticks and RK4 steps between them."""

    step: float  # integration step, s
    steps_per_tick: int
    ticks: int

    @property
    def tick(self) -> float:
        """Control period, s."""
        return self.step * self.steps_per_tick

    @property
    def duration(self) -> float:
        """Duration of the flight, s."""
        return self.tick * self.ticks
