"""Keep-out zones: signed distances as expressions of latitude and longitude, and outlines.

Distances are computed in the azimuthal equidistant projection about the centre of a zone, from the
tangent plane of the WGS-84 ellipsoid. Within 100 km of a zone that extends 50 km from its centre,
they agree with geodesics to 1 m.
"""

import math
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from abhv_mc.array_types import Floats
from abhv_mc.io.documents import StrictModel
from abhv_mc.io.messages import Refusal
from abhv_mc.io.units import Angle, Length
from abhv_mc_vehicle.vehicle_simulator.user_metrics import MetricEntry

_RADIUS, _E2 = 6378137.0, 6.69437999014e-3  # WGS-84: equatorial radius, m; squared eccentricity
_OUTLINE = 72  # number of points on the outline of a circle

Position = tuple[Angle, Angle]


class Zone(StrictModel):
    """Circle or convex polygon that flights must not enter."""

    center: Position | None = None
    """latitude and longitude of a circle's centre"""
    radius: Annotated[Length, Field(gt=0.0)] | None = None
    """radius of a circle"""
    polygon: Annotated[tuple[Position, ...], Field(min_length=3, max_length=20)] | None = None
    """latitude and longitude of each corner of a convex polygon, in order"""

    @model_validator(mode="after")
    def _check(self) -> "Zone":
        is_circle = self.center is not None and self.radius is not None
        if is_circle == (self.polygon is not None) or (self.center is None) != (
            self.radius is None
        ):
            raise Refusal("the zone has no single shape", "'center' and 'radius', or 'polygon'")
        if self.polygon is not None:
            _, along, _ = self._edges()
            turns = np.angle(np.exp(1j * np.diff(np.angle(along), append=np.angle(along[0]))))
            if not (np.all(turns > 1e-9) and math.isclose(turns.sum(), 2.0 * math.pi)):
                raise Refusal("the polygon is not convex", "a convex polygon", ("polygon",))
        return self

    @property
    def _origin(self) -> tuple[float, float]:
        if self.center is not None:
            return self.center
        latitude, longitude = np.mean(np.array(self.polygon), axis=0)
        return float(latitude), float(longitude)

    def _coefficients(self) -> tuple[float, float, float, float]:
        """Return the coefficients of the northward coordinate, and the squared radius."""
        sine = math.sin(self._origin[0])
        cosine = math.cos(self._origin[0])
        normal = _RADIUS / math.sqrt(1.0 - _E2 * sine * sine)
        squared = normal**2 * (1.0 - _E2) / (1.0 - _E2 * sine * sine)
        return (1.0 - _E2) * cosine, sine, _E2 * normal * sine * cosine, squared

    def _project(self, latitude: Floats, longitude: Floats) -> tuple[Floats, Floats]:
        """Return coordinates towards east and north, m, of latitudes and longitudes (rad)."""
        forward, up, shift, squared = self._coefficients()
        sine = np.sin(latitude)
        cosine = np.cos(latitude)
        normal = _RADIUS / np.sqrt(1.0 - _E2 * sine * sine)
        x = normal * cosine * np.sin(longitude - self._origin[1])
        y = normal * (forward * sine - up * cosine * np.cos(longitude - self._origin[1])) + shift
        h = x * x + y * y
        scale = 1.0 + h / (6.0 * squared) * (1.0 + 0.45 * h / squared)
        return scale * x, scale * y

    def _corners(self) -> Floats:
        """Return latitude and longitude (rad) of the corners [corner, 2], counterclockwise."""
        corners = np.array(self.polygon)
        y, x = (corners - corners[0]).T
        return corners[:: -1 if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) < 0.0 else 1]

    def _edges(self) -> tuple[Floats, Floats, Floats]:
        """Return the first corner, direction and length of each edge, counterclockwise.

        Corners and directions are complex numbers: east + i north.
        """
        x, y = self._project(*self._corners().T)
        corners = x + 1j * y
        following = np.roll(corners, -1)
        length = np.maximum(np.abs(following - corners), 1e-9)
        return corners, (following - corners) / length, length

    def expression(self) -> str:
        """Return the signed distance, m, as an expression; it is negative inside the zone."""
        forward, up, shift, squared = self._coefficients()
        p = f"(latitude_deg * {math.radians(1.0)!r})"
        q = f"(longitude_deg * {math.radians(1.0)!r} - {self._origin[1]!r})"
        normal = f"(d := {_RADIUS} / sqrt(1 - {_E2!r} * (o := sin{p}) * o))"
        x = f"(x := {normal} * (t := cos{p}) * sin{q})"
        y = f"(y := d * ({forward!r} * o - {up!r} * t * cos{q}) + {shift!r})"
        h = f"(h := {x} * x + {y} * y)"
        scale = f"(1 + {h} / {6.0 * squared!r} * (1 + h / {squared / 0.45!r}))"
        if self.polygon is None:
            return f"{scale} * sqrt(h) - {self.radius!r}"
        # The first argument of min only assigns the coordinates.
        distances = [f"(x := (h := {scale}) * x) * 0 + (y := h * y) * 0 + 1e30"]
        sides = []
        for corner, along, length in zip(
            *(values.tolist() for values in self._edges()), strict=True
        ):
            side = (
                f"{along.imag!r} * x - {along.real!r} * y - {(corner.conjugate() * along).imag!r}"
            )
            ahead = (
                f"{along.real!r} * x + {along.imag!r} * y - {(corner.conjugate() * along).real!r}"
            )
            beyond = f"max(-(t := {ahead}), t - {length!r}, 0)"
            distances.append(f"(d := {side}) * d + (o := {beyond}) * o")
            sides.append(side)
        return f"sqrt(min({', '.join(distances)})) + 2 * min(max({', '.join(sides)}), 0)"

    def outline(self) -> Floats:
        """Return latitudes and longitudes (deg) of the boundary [point, 2], counterclockwise.

        The last point is the first.
        """
        if self.polygon is not None:
            return np.degrees(self._corners()[[*range(len(self.polygon)), 0]])
        assert self.radius is not None  # noqa: S101
        angle = np.linspace(0.0, 2.0 * np.pi, _OUTLINE + 1)
        east = self.radius * np.cos(angle)
        north = self.radius * np.sin(angle)
        latitude, longitude = (np.full(len(angle), value) for value in self._origin)
        for _ in range(8):  # fixed-point iterations
            x, y = self._project(latitude, longitude)
            latitude = latitude + (north - y) / _RADIUS
            longitude = longitude + (east - x) / (_RADIUS * math.cos(self._origin[0]))
        return np.degrees(np.column_stack([latitude, longitude]))

    def metric(self, name: str) -> MetricEntry:
        """Return the metric of the smallest signed distance from the zone."""
        return MetricEntry(
            of=self.expression(),
            statistic="min",
            unit="m",
            bad="low",
            label=f"distance from {name.replace('_', ' ')}",
            doc=f"smallest distance of the ground track from the zone {name}; negative inside",
        )
