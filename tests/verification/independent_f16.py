"""The F-16's check-cases a second time: inertial Cartesian equations, RK4, the DAVE-ML graphs by their own evaluator.

The law acts without delay, as in the published simulators.
"""

import math
from pathlib import Path

import numpy as np
from ambiance import Atmosphere
from daveml.graph import Graph
from scipy.optimize import root
from scipy.spatial.transform import Rotation
from verification.independent import FT, SLUG, World, local_axes

KNOT = 1852.0 / 3600.0
FOLDER = Path(__file__).parents[1] / "reference" / "daveml"
R, V, BODY, OMEGA, ACROSS = slice(0, 3), slice(3, 6), slice(6, 15), slice(15, 18), 18


class F16:
    """One case: altitude (ft), north and east velocity (ft/s), latitude and longitude (deg), the law and its commands.

    ``steps``: {command: (time, gain)} in the law's units; ``across``: whether the law is told the lateral deviation.
    """

    def __init__(self, altitude, velocity, latitude, longitude, law, engaged=False, across=False, steps=None, **given):
        self.world, self.across, self.steps = World(), across, steps or {}
        self.graphs = {name: Graph(FOLDER / f"F16_{name}.dml") for name in ("aero", "prop", law)}
        self.law = law
        body = Graph(FOLDER / "F16_inertia.dml")
        values = body.evaluate(dict.fromkeys(body.inputs, 25.0))
        xx, yy, zz, zx = (values[name] * SLUG * FT**2 for name in ("XIXX", "XIYY", "XIZZ", "XIZX"))
        self.inertia = np.array([[xx, 0.0, -zx], [0.0, yy, 0.0], [-zx, 0.0, zz]])
        self.inverse = np.linalg.inv(self.inertia)
        self.mass, self.arm = values["XMASS"] * SLUG, -values["DXCG"] * FT
        self.course = math.degrees(math.atan2(velocity[1], velocity[0]))
        speed = math.hypot(*velocity) * FT * math.sqrt(Atmosphere(altitude * FT).density[0] / 1.225)
        self.given = {"altCmd": altitude, "keasCmd": speed / KNOT, "baseChiCmd": self.course, **given}
        self._trim(altitude, velocity, latitude, longitude, engaged)

    def _trim(self, altitude, velocity, latitude, longitude, engaged):
        lat, lon = math.radians(latitude), math.radians(longitude)
        w, e2 = self.world, self.world.f * (2.0 - self.world.f)
        n, h = w.a / math.sqrt(1.0 - e2 * math.sin(lat) ** 2), altitude * FT
        m = n * (1.0 - e2) / (1.0 - e2 * math.sin(lat) ** 2)
        cos_lat, sin_lat = math.cos(lat), math.sin(lat)
        r = np.array(
            [(n + h) * cos_lat * math.cos(lon), (n + h) * cos_lat * math.sin(lon), (n * (1 - e2) + h) * sin_lat]
        )
        axes = local_axes(lat, lon)
        north, east = (FT * v for v in velocity)
        turn = east / ((n + h) * cos_lat) + w.omega[2]
        frame = np.array([turn * cos_lat, -north / (m + h), -turn * sin_lat])
        inertial = axes.T @ [north, east, 0.0] + np.cross(w.omega, r)

        def state(alpha):
            local = Rotation.from_euler("ZYX", [self.course, math.degrees(alpha), 0.0], degrees=True).as_matrix()
            return np.concatenate([r, inertial, (axes.T @ local).ravel(), local.T @ frame, [0.0]])

        def accelerations(guess):
            x = state(guess[0])
            rate, body = self._rate(x, (guess[1], 0.0, 0.0, guess[2])), x[BODY].reshape(3, 3)
            relative = rate[V] - np.cross(w.omega, x[V])
            along = body.T @ relative - np.cross(x[OMEGA], body.T @ (x[V] - np.cross(w.omega, x[R])))
            return along[0], along[2], rate[OMEGA][1]

        alpha, elevator, throttle = root(accelerations, [0.046, -3.2, 14.0], tol=1e-12).x
        self.start = state(alpha)
        self.given |= {"longStkTrim": elevator / -25.0, "throttleTrim": throttle / 100.0}
        if engaged:  # the law holds the trim at the start
            asked = self.controls(self.start, 0.0)
            self.given["longStkTrim"] += (elevator - asked[0]) / -25.0
            self.given["throttleTrim"] += (throttle - asked[3]) / 100.0

    def motion(self, x, t):
        """Latitude, longitude, altitude, NED velocity, attitude to NED, of a time."""
        lat, h = self.world.geodetic(x[R])
        lon = math.atan2(x[1], x[0]) - self.world.omega[2] * t
        axes = local_axes(lat, math.atan2(x[1], x[0]))
        return lat, lon, h, axes @ (x[V] - np.cross(self.world.omega, x[R])), axes @ x[BODY].reshape(3, 3)

    def _air(self, x):
        body = x[BODY].reshape(3, 3).T @ (x[V] - np.cross(self.world.omega, x[R]))
        speed = np.linalg.norm(body)
        return speed, math.degrees(math.atan2(body[2], body[0])), math.degrees(math.asin(body[1] / speed))

    def controls(self, x, t):
        """Elevator, aileron, rudder (deg, as in the files) and power (%)."""
        lat, lon, h, _, local = self.motion(x, t)
        speed, alpha, beta = self._air(x)
        psi, theta, phi = Rotation.from_matrix(local).as_euler("ZYX", degrees=True)
        lon = (math.degrees(lon) + 180.0) % 360.0 - 180.0
        seen = {"alpha": alpha, "beta": beta, "psi": psi, "theta": theta, "phi": phi, "altMsl": h / FT}
        seen |= {"pb": x[15], "qb": x[16], "rb": x[17], "ownshipN_deg": math.degrees(lat), "ownshipE_deg": lon}
        seen |= {"Vequiv": speed * math.sqrt(Atmosphere(h).density[0] / 1.225) / KNOT, "latOffset": 0.0}
        given = dict(self.given)
        if self.across:
            given["latOffset"] = x[ACROSS] / FT
        for name, (at, gain) in self.steps.items():
            given[name] = given.get(name, 0.0) + (gain if t >= at else 0.0)
        graph = self.graphs[self.law]
        found = graph.evaluate({name: ({**seen, **given}).get(name, 0.0) for name in graph.inputs})
        return found["el"], found["ail"], found["rdr"], found["PWR"]

    def _rate(self, x, controls, course=None):
        el, ail, rdr, power = controls
        body, omega = x[BODY].reshape(3, 3), x[OMEGA]
        h = self.world.geodetic(x[R])[1]
        speed, alpha, beta = self._air(x)
        air = Atmosphere(h)
        p, q, r = omega - body.T @ self.world.omega
        moving = {"vt": speed / FT, "alpha": alpha, "beta": beta, "p": p, "q": q, "r": r}
        moving |= {"el": el, "ail": ail, "rdr": rdr}
        c = self.graphs["aero"].evaluate(moving)
        pressure = 0.5 * air.density[0] * speed**2 * 300.0 * FT**2
        engine = {"PWR": power, "ALT": h / FT, "RMACH": speed / air.speed_of_sound[0]}
        thrust = self.graphs["prop"].evaluate(engine)["FEX"] * 4.4482216152605
        force = pressure * np.array([c["cx"], c["cy"], c["cz"]]) + [thrust, 0.0, 0.0]
        moment = pressure * FT * np.array([30.0 * c["cl"], 11.32 * c["cm"], 30.0 * c["cn"]])
        moment += np.cross([self.arm, 0.0, 0.0], force)
        cross = np.array([[0.0, -omega[2], omega[1]], [omega[2], 0.0, -omega[0]], [-omega[1], omega[0], 0.0]])
        rate = np.empty_like(x)
        rate[R], rate[V] = x[V], self.world.gravity(x[R]) + body @ force / self.mass
        rate[BODY] = (body @ cross).ravel()
        rate[OMEGA] = self.inverse @ (moment - np.cross(omega, self.inertia @ omega))
        rate[ACROSS] = 0.0
        if course is not None:  # to the right of the commanded course
            east = np.array([-x[1], x[0], 0.0]) / math.hypot(x[0], x[1])
            lat = self.world.geodetic(x[R])[0]
            down = -np.array([*(math.cos(lat) * x[:2] / math.hypot(x[0], x[1])), math.sin(lat)])
            to_earth = x[V] - np.cross(self.world.omega, x[R])
            v_north, v_east = to_earth @ np.cross(east, down), to_earth @ east
            rate[ACROSS] = v_east * math.cos(course) - v_north * math.sin(course)
        return rate

    def fly(self, duration, step=0.01, every=10):
        """Rows of a published file, ``every`` steps."""
        x, rows = self.start.copy(), []
        course = math.radians(self.course)
        for i in range(round(duration / step) + 1):
            t = i * step
            if i % every == 0:
                lat, lon, h, velocity, local = self.motion(x, t)
                angles = Rotation.from_matrix(local).as_euler("ZYX", degrees=True)
                lon = (math.degrees(lon) + 180.0) % 360.0 - 180.0
                rates = np.degrees(x[OMEGA])
                rows.append([t, h / FT, lon, math.degrees(lat), *velocity / FT, *angles, *rates, 0.0])

            def rate(y, ahead, t=t):
                now = min(t + ahead, t + step - 1e-9)  # commands are those of the step
                return self._rate(y, self.controls(y, now), course)

            k1 = rate(x, 0.0)
            k2 = rate(x + 0.5 * step * k1, 0.5 * step)
            k3 = rate(x + 0.5 * step * k2, 0.5 * step)
            k4 = rate(x + step * k3, step)
            x = x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return rows


LEVEL = {"altitude": 10013.0, "velocity": (400.0, 400.0), "latitude": 36.01916667, "longitude": -75.67444444}
TURNED = {"sasOn": 1.0, "apOn": 1.0}
CASES = {
    "13p1": {**LEVEL, **TURNED, "law": "control", "engaged": True, "steps": {"altCmd": (5.0, 100.0)}},
    "13p3": {**LEVEL, **TURNED, "law": "control", "engaged": True, "steps": {"baseChiCmd": (15.0, 15.0)}},
    "13p4": {
        **LEVEL, **TURNED, "law": "control", "engaged": True, "across": True, "steps": {"latOffset": (20.0, -2000.0)},
    },
    "15": {
        **TURNED, "altitude": 1e4, "velocity": (0.0, 563.643), "latitude": 89.95, "longitude": -45.0, "law": "gnc",
        "circlePoleSW": 1.0,
    },
    "16": {
        **TURNED, "altitude": 1e4, "velocity": (563.643, 0.0), "latitude": 0.0, "longitude": -179.95, "law": "gnc",
        "circlePoleSW": 0.0,
    },
}  # fmt: skip
