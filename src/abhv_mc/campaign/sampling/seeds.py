"""Seeds of turbulence and sensor noise: a column of the samples as soon as there is such noise, and no dispersion.

Without a seed of its own every flight would meet the same gusts, and the flights would not be independent.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.designs import FACTORIAL
from abhv_mc.campaign.sampling.streams import draw_uniforms, stream_key
from abhv_mc.kernel.plant.parameter_names import SENSOR_NOISES
from abhv_mc.plant.parameters import OURS, Parameters

NOISE_OF_SEED = {"wind.turbulence_seed": ("wind.turbulence",), "sensor.noise_seed": SENSOR_NOISES}
"""By seed, the parameters that make the noise that it belongs to."""


_WHOLE = 2.0**52  # a seed of a user's simulator is a whole number below it


def find_seeds(names: Sequence[str], parameters: Parameters = OURS) -> tuple[str, ...]:
    """The seeds that flights need whose samples have columns of these names, and that are not among them; all of a
    user's simulator."""
    if parameters is not OURS:
        return tuple(record.name for record in parameters.records if record.seed)
    there = {*names, *(parameter.name for parameter in parameters.records if parameter.nominal != 0.0)}
    return tuple(seed for seed, noises in NOISE_OF_SEED.items() if seed not in names and there.intersection(noises))


def draw_seeds(name: str, seed: int, first: int, count: int) -> Floats:
    """Values [flight] of a seed: in 0..1, of a user's simulator whole numbers."""
    drawn = draw_uniforms(stream_key(seed, name), first, count)
    return drawn if name in NOISE_OF_SEED else np.floor(drawn * _WHOLE)


@dataclass(frozen=True)
class Seeds:
    """The seeds of a campaign's flights."""

    names: tuple[str, ...]
    seed: int  # of the campaign
    design: str

    def draw(self, first: int, stop: int) -> Floats:
        """Values ``[flight, seed]`` of the flights ``first`` .. ``stop - 1``, each from (seed, name, flight).

        Flights that are compared with each other by their design, all of a factorial one, have a common one.
        """
        numbers = np.arange(first, stop)
        if self.design in FACTORIAL:
            numbers = np.zeros_like(numbers)
        if not numbers.size:
            return np.empty((0, len(self.names)))
        low, count = int(numbers[0]), int(numbers[-1] - numbers[0]) + 1
        columns = [draw_seeds(name, self.seed, low, count)[numbers - low] for name in self.names]
        return np.column_stack(columns)
