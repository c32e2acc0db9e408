"""Keep-out zones: distances against geodesics, outlines, and invalid zones."""

import math

import numpy as np
import pytest
from matplotlib.path import Path as MatplotlibPath

from abhv_mc.flights.expressions import compile_expression
from abhv_mc.flights.statistic import MAX_REGISTERS
from abhv_mc.io.documents import Document, validate
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.compile_metrics import source_rows
from abhv_mc_vehicle.vehicle_simulator.keep_out import Zone
from abhv_mc_vehicle.vehicle_simulator.user_metrics import pack_sources

A, F = 6378137.0, 1.0 / 298.257223563
CORNERS = ((29.1, -77.6), (29.2, -77.1), (29.5, -77.0), (29.6, -77.7))


def geodesic(latitude, longitude, latitude_2, longitude_2):
    """Return the length of a geodesic on WGS-84, m (Vincenty, Survey Review 23, 1975)."""
    u, v = (np.arctan((1.0 - F) * np.tan(np.radians(x))) for x in (latitude, latitude_2))
    along = first = np.radians(longitude_2 - longitude)
    for _ in range(12):
        across = np.hypot(
            np.cos(v) * np.sin(along),
            np.cos(u) * np.sin(v) - np.sin(u) * np.cos(v) * np.cos(along),
        )
        across = np.maximum(across, 1e-15)
        cosine = np.sin(u) * np.sin(v) + np.cos(u) * np.cos(v) * np.cos(along)
        sigma = np.arctan2(across, cosine)
        azimuth = np.cos(u) * np.cos(v) * np.sin(along) / across
        squared = 1.0 - azimuth**2
        middle = cosine - 2.0 * np.sin(u) * np.sin(v) / np.maximum(squared, 1e-15)
        c = F / 16.0 * squared * (4.0 + F * (4.0 - 3.0 * squared))
        inner = middle + c * cosine * (2.0 * middle**2 - 1.0)
        along = first + (1.0 - c) * F * azimuth * (sigma + c * across * inner)
    k = squared * ((1.0 / (1.0 - F)) ** 2 - 1.0)
    a = 1.0 + k / 16384.0 * (4096.0 + k * (-768.0 + k * (320.0 - 175.0 * k)))
    b = k / 1024.0 * (256.0 + k * (-128.0 + k * (74.0 - 47.0 * k)))
    inner = cosine * (2.0 * middle**2 - 1.0) - b / 6.0 * middle * (4.0 * across**2 - 3.0) * (
        4.0 * middle**2 - 3.0
    )
    return A * (1.0 - F) * a * (sigma - b * across * (middle + b / 4.0 * inner))


def on_ellipsoid(latitude, longitude):
    p, q = np.radians(latitude), np.radians(longitude)
    e2 = F * (2.0 - F)
    n = A / np.sqrt(1.0 - e2 * np.sin(p) ** 2)
    return np.array(
        [n * np.cos(p) * np.cos(q), n * np.cos(p) * np.sin(q), n * (1 - e2) * np.sin(p)]
    )


def edge(first, second):
    """Return latitudes and longitudes (deg) along the ellipsoid between two corners."""
    share = np.linspace(0.0, 1.0, 2_001)[:, None]
    x, y, z = ((1.0 - share) * on_ellipsoid(*first) + share * on_ellipsoid(*second)).T
    e2 = F * (2.0 - F)
    return np.degrees(np.arctan2(z, (1.0 - e2) * np.hypot(x, y))), np.degrees(np.arctan2(y, x))


def make(**keys):
    return validate(Document("zone", keys, {(): (1, 1)}, {}), Zone)


def signed(zone, latitude, longitude):
    """Evaluate the expression as Python does, which has the same operators."""
    names = {name: getattr(math, name) for name in ("sin", "cos", "sqrt")}
    where = {"latitude_deg": latitude, "longitude_deg": longitude}
    return eval(zone.expression(), {**names, **where, "min": min, "max": max})  # noqa: S307


@pytest.mark.parametrize("corners", [CORNERS, CORNERS[::-1]])
def test_distances_are_those_of_geodesics(corners):
    circle = make(center=["29.3 deg", "-77.4 deg"], radius="20 km")
    polygon = make(polygon=[[f"{x} deg", f"{y} deg"] for x, y in corners])
    edges = [edge(a, b) for a, b in zip(CORNERS, (*CORNERS[1:], CORNERS[0]), strict=True)]
    for latitude in (28.8, 29.15, 29.3, 29.41, 29.9):
        for longitude in (-78.3, -77.72, -77.4, -77.2, -76.8):
            expected = geodesic(latitude, longitude, 29.3, -77.4) - 20e3
            assert signed(circle, latitude, longitude) == pytest.approx(expected, abs=0.1)
            nearest = min(geodesic(latitude, longitude, *line).min() for line in edges)
            found = signed(polygon, latitude, longitude)
            assert abs(found) == pytest.approx(nearest, abs=1.0)
            assert (found < 0.0) == MatplotlibPath(CORNERS).contains_point((latitude, longitude))


def test_the_boundary_has_no_distance():
    for zone in (
        make(center=["-41 deg", "179.99 deg"], radius="50 km"),
        make(polygon=[[f"{x} deg", f"{y} deg"] for x, y in CORNERS]),
    ):
        outline = zone.outline()
        assert (outline[0] == outline[-1]).all()
        assert np.sum(outline[:-1, 1] * np.diff(outline[:, 0])) > 0.0  # counterclockwise
        for latitude, longitude in outline:
            assert abs(signed(zone, latitude, longitude)) < 1e-3


def test_the_largest_polygon_fits_into_the_registers():
    angle = np.linspace(0.0, 2.0 * np.pi, 20, endpoint=False)
    corners = [[f"{29 + 0.1 * math.sin(a)} deg", f"{-77 + 0.1 * math.cos(a)} deg"] for a in angle]
    program = compile_expression(make(polygon=corners).expression(), source_rows(pack_sources(())))
    assert max(line[1] for line in program.code) < MAX_REGISTERS


@pytest.mark.parametrize(
    ("keys", "fragment"),
    [
        ({"center": ["29 deg", "0 deg"]}, "shape"),
        ({"polygon": [["0 deg", "0 deg"], ["1 deg", "0 deg"], ["2 deg", "0 deg"]]}, "convex"),
        (  # a pentagram turns twice
            {
                "polygon": [
                    [f"{math.sin(0.8 * k * math.pi)} deg", f"{math.cos(0.8 * k * math.pi)} deg"]
                    for k in range(5)
                ]
            },
            "convex",
        ),
    ],
)
def test_an_invalid_zone_is_rejected(keys, fragment):
    with pytest.raises(InputError, match=fragment):
        make(**keys)
