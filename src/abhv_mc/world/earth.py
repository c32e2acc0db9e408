"""The Earth as numbers: figure, gravity and rotation. A sphere or a still Earth is a choice of numbers."""

from typing import NamedTuple


class Earth(NamedTuple):
    """Figure, gravity and rotation of the Earth, SI."""

    equatorial_radius: float  # m
    flattening: float  # 0 for a sphere
    gravitational_parameter: float  # GM, m3/s2
    j2: float  # 0 for a central field
    rotation_rate: float  # rad/s, 0 for a still Earth


WGS84 = Earth(6378137.0, 1.0 / 298.257223563, 3.986004418e14, 1.08262982e-3, 7.292115e-5)
