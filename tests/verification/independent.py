"""Independent solution of the check-cases.

It integrates inertial Cartesian equations by DOP853, with ambiance's atmosphere.

Shares nothing with the package; numbers are those of NASA/TM-2015-218675.
"""

import csv
from pathlib import Path

import numpy as np
from ambiance import Atmosphere
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

FT = 0.3048
SLUG = 14.59390293720636  # kg
HEADER = [
    "time,altitudeMsl_ft,longitude_deg,latitude_deg,feVelocity_ft_s_X,feVelocity_ft_s_Y,feVelocity_ft_s_Z",
    "eulerAngle_deg_Yaw,eulerAngle_deg_Pitch,eulerAngle_deg_Roll",
    "bodyAngularRateWrtEi_deg_s_Roll,bodyAngularRateWrtEi_deg_s_Pitch,bodyAngularRateWrtEi_deg_s_Yaw,mach",
]


class World:
    def __init__(
        self,
        a=6378137.0,
        f=1 / 298.257223563,
        gm=3.986004418e14,
        j2=0.00108262982,
        omega=7.292115e-5,
    ):
        self.a, self.f, self.gm, self.j2 = a, f, gm, j2
        self.omega = np.array([0.0, 0.0, omega])

    def gravity(self, r):
        """At a place or at many, [3, place]."""
        d = np.linalg.norm(r, axis=0)
        k = 1.5 * self.j2 * (self.a / d) ** 2
        s2 = 5.0 * (r[2] / d) ** 2
        return (
            -self.gm
            / d**3
            * r
            * (1.0 + k * (np.array([1.0, 1.0, 3.0]).reshape(3, *[1] * np.ndim(d)) - s2))
        )

    def place(self, lat, lon, h):
        """Earth-centred coordinates."""
        e2 = self.f * (2.0 - self.f)
        n = self.a / np.sqrt(1.0 - e2 * np.sin(lat) ** 2)
        across = (n + h) * np.cos(lat)
        return np.array(
            [across * np.cos(lon), across * np.sin(lon), (n * (1.0 - e2) + h) * np.sin(lat)]
        )

    def geodetic(self, r):
        """Latitude and altitude by fixed-point iteration."""
        e2 = self.f * (2.0 - self.f)
        rho = np.hypot(r[0], r[1])
        lat = np.arctan2(r[2], rho * (1.0 - e2))
        for _ in range(8):
            n = self.a / np.sqrt(1.0 - e2 * np.sin(lat) ** 2)
            lat = np.arctan2(r[2] + e2 * n * np.sin(lat), rho)
        n = self.a / np.sqrt(1.0 - e2 * np.sin(lat) ** 2)
        return lat, rho * np.cos(lat) + r[2] * np.sin(lat) - n * (1.0 - e2 * np.sin(lat) ** 2)


def local_axes(lat, lon):
    """North, east, down as rows."""
    down = -np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0 * lon])
    return np.array([np.cross(east, down, axis=0), east, down])


def fly_sphere(
    world,
    altitude=30000.0,
    velocity_ned=(0, 0, 0),
    heading=0.0,
    rates_dps=(0, 0, 0),
    wind=lambda h: 0.0,
    latitude=0.0,
):
    """Return rows of a published file for a sphere of 1 slug and CD 0.1.

    Feet and degrees, 0.1 s apart; wind(h ft) in ft/s.
    """
    area = 0.1963495 * FT**2
    lat = np.radians(latitude)
    axes = local_axes(lat, 0.0)
    r0 = world.place(lat, 0.0, altitude * FT)
    v0 = axes.T @ (np.array(velocity_ned) * FT) + np.cross(world.omega, r0)
    body0 = axes.T @ Rotation.from_euler("z", heading, degrees=True).as_matrix()
    rates = np.radians(rates_dps)  # constant: a sphere without moments

    def rate(_, x):
        r, v = x[:3], x[3:]
        h = world.geodetic(r)[1]
        east = np.array([-r[1], r[0], 0.0]) / np.hypot(r[0], r[1])
        air = v - np.cross(world.omega, r) - wind(h / FT) * FT * east
        drag = -0.5 * Atmosphere(h).density[0] * 0.1 * area * np.linalg.norm(air) * air
        return np.concatenate([v, world.gravity(r) + drag / SLUG])

    times = np.linspace(0.0, 30.0, 301)
    flown = solve_ivp(
        rate, (0.0, 30.0), np.concatenate([r0, v0]), "DOP853", times, rtol=1e-11, atol=1e-9
    )
    rows = []
    for t, x in zip(times, flown.y.T, strict=True):
        r, v = x[:3], x[3:]
        lat, h = world.geodetic(r)
        lon = np.arctan2(r[1], r[0])
        local = local_axes(lat, lon)
        to_earth = local @ (v - np.cross(world.omega, r))
        body = body0 @ Rotation.from_rotvec(rates * t).as_matrix()
        yaw, pitch, roll = Rotation.from_matrix(local @ body).as_euler("ZYX", degrees=True)
        turned = np.degrees((lon - world.omega[2] * t + np.pi) % (2 * np.pi) - np.pi)
        rows.append(
            [
                t,
                h / FT,
                turned,
                np.degrees(lat),
                *to_earth / FT,
                yaw % 360.0,
                pitch,
                roll,
                *rates_dps,
                0.0,
            ]
        )
    return rows


def write_case(folder: Path, case: str, name: str, simulator: str, rows) -> Path:
    path = folder / f"Atmos_{case}_{name}" / f"Atmos_{case}_sim_{simulator}.csv"
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(",".join(HEADER).split(","))
        writer.writerows(rows)
    return path
