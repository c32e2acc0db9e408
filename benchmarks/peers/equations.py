"""The plant and the LQR law in JAX, one flight as scalars: what ``jax.vmap`` turns into a batch.

The equations of ``abhv_mc.plant`` and ``abhv_mc.kernel.laws.lqr`` with the plan's numbers as constants of the trace.
Left out, since these flights need none of it: limits of the actuators, gusts, turbulence, sensor errors, metrics.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from abhv_mc.flight.plan import FlightPlan
from abhv_mc.kernel.laws import columns as ref
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.kernel.plant.state import STATES
from abhv_mc.kernel.plant.vehicle import COEFFICIENTS, FIXED_TABLE_ROWS, VARIABLES, Vehicle

Scalar = Any  # of the trace
State = dict[str, Scalar]
ACTUATORS = ("aileron", "rudder", "elevator", "equivalence_ratio")
RIGID = STATES[: STATES.index("aileron")]

_BASE = np.array([0.0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3])
_TEMPERATURE = np.array([288.15, 216.65, 216.65, 228.65, 270.65, 270.65, 214.65])
_LAPSE = np.array([-6.5e-3, 0.0, 1e-3, 2.8e-3, 0.0, -2.8e-3, -2e-3])
_PRESSURE = np.array(
    [
        101325.0,
        22632.06397346293,
        5474.88866967778,
        868.0186847552274,
        110.90630555496588,
        66.93887311868727,
        3.9564204280407287,
    ]
)


def atmosphere(altitude: Scalar) -> tuple[Scalar, Scalar]:
    """(density, speed of sound) of US 1976 up to 84 km."""
    gas, gravity = 8314.32 / 28.9644, 9.80665
    height = 6356766.0 * altitude / (6356766.0 + altitude)
    base, temperature, lapse, pressure = (
        sum(
            jnp.where(height >= _BASE[i], column[i] - (column[i - 1] if i else 0.0), 0.0)
            for i in range(len(_BASE))
        )
        for column in (_BASE, _TEMPERATURE, _LAPSE, _PRESSURE)
    )
    above = height - base
    # The sums of differences leave a lapse of 1e-19 where it is none.
    isothermal = jnp.abs(lapse) < 1e-9
    local = temperature + lapse * above
    exponent = (
        -gravity
        / gas
        * jnp.where(
            isothermal,
            above / temperature,
            jnp.log(local / temperature) / jnp.where(isothermal, 1.0, lapse),
        )
    )
    return pressure * jnp.exp(exponent) / (gas * local), jnp.sqrt(1.4 * gas * local)


def to_ned(q: tuple, v: tuple) -> tuple:
    """North, east, down components of a body vector."""
    w, x, y, z = q
    return (
        (1 - 2 * (y * y + z * z)) * v[0] + 2 * (x * y - w * z) * v[1] + 2 * (x * z + w * y) * v[2],
        2 * (x * y + w * z) * v[0] + (1 - 2 * (x * x + z * z)) * v[1] + 2 * (y * z - w * x) * v[2],
        2 * (x * z - w * y) * v[0] + 2 * (y * z + w * x) * v[1] + (1 - 2 * (x * x + y * y)) * v[2],
    )


def to_body(q: tuple, v: tuple) -> tuple:
    """Body components of a north-east-down vector."""
    return to_ned((q[0], -q[1], -q[2], -q[3]), v)


def attitude_of(x: State) -> tuple:
    """The quaternion of a state."""
    return x["q0"], x["q1"], x["q2"], x["q3"]


def cross(a: tuple, b: tuple) -> tuple:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def flow_of(v: tuple) -> tuple:
    """Speed, sin alpha, cos alpha, sin beta, cos beta, alpha, beta."""
    in_plane = jnp.sqrt(v[0] * v[0] + v[2] * v[2])
    speed = jnp.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    alpha, beta = jnp.arctan2(v[2], v[0]), jnp.arctan2(v[1], in_plane)
    return speed, v[2] / in_plane, v[0] / in_plane, v[1] / speed, in_plane / speed, alpha, beta


def make_look_up(vehicle: Vehicle) -> Callable[[dict[str, Scalar]], dict[int, Scalar]]:
    """Every table by its row. The four corners of a cell lie side by side: one gather for each group of tables."""
    t = vehicle.tables
    if (t.group_dimensions != 2).any():
        raise ValueError("the JAX peer knows tables of two dimensions")
    groups = []
    for g in range(t.group_start.size):
        grids = [
            t.grid[t.axis_start[a] : t.axis_start[a] + t.axis_length[a]]
            for a in t.group_axis[g, :2]
        ]
        i, j = np.meshgrid(*(np.arange(len(grid) - 1) for grid in grids), indexing="ij")
        s0, s1 = t.group_stride[g, :2]
        first = t.group_start[g] + i * s0 + j * s1
        corners = np.stack([first, first + s0, first + s1, first + s0 + s1], axis=-1)
        cells = t.data[
            corners[..., np.newaxis] + np.arange(t.group_used[g])
        ]  # [cell, cell, corner, table]
        names = [VARIABLES[t.axis_variable[a]] for a in t.group_axis[g, :2]]
        groups.append((names, grids, cells, int(t.group_row[g])))

    def bracket(grid: np.ndarray, x: Scalar) -> tuple[Scalar, Scalar]:
        inside = jnp.clip(x, grid[0], grid[-1])
        index = (
            sum((inside >= node).astype(jnp.int32) for node in grid[1:-1]) if len(grid) > 2 else 0
        )
        low, step = jnp.asarray(grid)[index], jnp.asarray(np.diff(grid))[index]
        return index, (inside - low) / step

    def look_up(variables: dict[str, Scalar]) -> dict[int, Scalar]:
        rows = {}
        for names, grids, cells, row in groups:
            if names[0] == "one":  # constants
                values = cells[0, 0].mean(axis=0)
            else:
                (i, s), (j, t) = (
                    bracket(grid, variables[name]) for grid, name in zip(grids, names, strict=True)
                )
                weights = jnp.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t])
                values = weights @ jnp.asarray(cells)[i, j]
            rows.update({row + k: values[k] for k in range(cells.shape[-1])})
        return rows

    return look_up


def make_derivative(plan: FlightPlan) -> Callable[[State, Callable[[str], Scalar]], State]:
    """Derivatives of the 14 rigid-body states; ``p(name)`` gives a dispersion."""
    c, earth, terms = plan.vehicle.constants, plan.earth, plan.vehicle.build_up
    look_up = make_look_up(plan.vehicle)
    parameters = list(PARAMETER_INDEX)
    fixed_row = dict(zip(FIXED_TABLE_ROWS, plan.vehicle.tables.fixed_row.tolist(), strict=True))
    e2 = earth.flattening * (2.0 - earth.flattening)

    def derivative(x: State, p: Callable[[str], Scalar]) -> State:
        q, v = attitude_of(x), (x["u"], x["v"], x["w"])
        rate = (x["roll_rate"], x["pitch_rate"], x["yaw_rate"])
        sin_lat, cos_lat = jnp.sin(x["latitude"]), jnp.cos(x["latitude"])
        turn = to_body(q, (earth.rotation_rate * cos_lat, 0.0, -earth.rotation_rate * sin_lat))
        h = x["altitude"]
        wind = to_body(
            q,
            (
                p("wind.north") + p("wind.shear_north") * h,
                p("wind.east") + p("wind.shear_east") * h,
                0.0,
            ),
        )
        speed, sin_a, cos_a, _, _, alpha, beta = flow_of(tuple(v[i] - wind[i] for i in range(3)))
        density, sound = atmosphere(h)
        rho = density * p("atmosphere.density")
        q_bar = 0.5 * rho * speed * speed
        half = 0.5 / speed
        surfaces = [p(f"control.{name}_effectiveness") * x[name] for name in ACTUATORS[:3]]
        variables = {
            "one": 1.0,
            "mach": speed / sound,
            "angle_of_attack": alpha,
            "sideslip": beta,
            "roll_rate_hat": (rate[0] - turn[0]) * c.span * half,
            "pitch_rate_hat": (rate[1] - turn[1]) * c.chord * half,
            "yaw_rate_hat": (rate[2] - turn[2]) * c.span * half,
            **dict(zip(ACTUATORS[:3], surfaces, strict=True)),
            "equivalence_ratio": x["equivalence_ratio"],
            "altitude": h,
            "mass": x["mass"] / p("mass.total"),
        }
        for e, mix in enumerate(plan.vehicle.effector_mix):
            variables[f"effector_{e}"] = sum(mix[i] * surfaces[i] for i in range(3))
        rows = look_up(variables)
        fixed = {name: rows[row] for name, row in fixed_row.items()}
        coefficient = dict.fromkeys(COEFFICIENTS, 0.0)
        for i in range(terms.coefficient.size):
            value = rows[int(terms.table[i])] * variables[VARIABLES[terms.variable[i]]]
            coefficient[COEFFICIENTS[terms.coefficient[i]]] += (
                p(parameters[terms.factor[i]]) * value
            )

        # Forces and moments about the centre of gravity (drag and lift in stability axes).
        k = {name: p(f"aero.{name}") * coefficient[name] for name in COEFFICIENTS}
        lift, drag = k["lift"] + p("aero.lift.increment"), k["drag"] + p("aero.drag.increment")
        q_s = q_bar * c.area
        fx, fy, fz = (
            q_s * (lift * sin_a - drag * cos_a),
            q_s * k["side_force"],
            q_s * (-lift * cos_a - drag * sin_a),
        )
        isp = fixed["specific_impulse"]
        captured = (
            c.capture_thrust * x["equivalence_ratio"] * rho * speed * fixed["capture_area_ratio"]
        )
        nominal_thrust = captured * isp + q_bar * fixed["thrust_area"]
        fuel_left = (x["mass"] > c.mass_empty * p("mass.total")) | (c.burns_fuel == 0.0)
        nominal_thrust = jnp.where(fuel_left, nominal_thrust, 0.0)
        thrust = p("propulsion.thrust") * nominal_thrust
        tx, tz = thrust * c.thrust_cos, -thrust * c.thrust_sin
        cg_x = fixed["center_of_gravity_x"] + p("mass.center_of_gravity_x")
        cg_y = p("mass.center_of_gravity_y")
        cg_z = fixed["center_of_gravity_z"] + p("mass.center_of_gravity_z")
        pitch = k["pitching_moment"] + p("aero.pitching_moment.increment")
        moment = (
            q_s * c.span * k["rolling_moment"] - cg_y * (fz + tz) + cg_z * fy,
            q_s * c.chord * pitch + cg_x * (fz + tz) - cg_z * fx + (c.thrust_offset_z - cg_z) * tx,
            q_s * c.span * k["yawing_moment"] - cg_x * fy + cg_y * (fx + tx),
        )

        # Rotation, translation over the ellipsoid, attitude.
        ixx, iyy, izz, i13 = (
            fixed[f"inertia_{axes}"] * p(f"mass.inertia_{axes}")
            for axes in ("xx", "yy", "zz", "13")
        )
        momentum = (ixx * rate[0] + i13 * rate[2], iyy * rate[1], izz * rate[2] + i13 * rate[0])
        gyroscopic = cross(rate, momentum)
        n = tuple(moment[i] - gyroscopic[i] for i in range(3))
        inverse = 1.0 / (ixx * izz - i13 * i13)
        w2 = 1.0 - e2 * sin_lat * sin_lat
        vertical = earth.equatorial_radius / jnp.sqrt(w2)
        meridian = vertical * (1.0 - e2) / w2
        rho_axis, z = (vertical + h) * cos_lat, (vertical * (1.0 - e2) + h) * sin_lat
        inverse_square = 1.0 / (rho_axis * rho_axis + z * z)
        central = earth.gravitational_parameter * inverse_square * jnp.sqrt(inverse_square)
        j2 = 1.5 * earth.j2 * earth.equatorial_radius**2 * inverse_square
        tilt = 5.0 * z * z * inverse_square
        g_rho = (earth.rotation_rate**2 - central * (1.0 + j2 * (1.0 - tilt))) * rho_axis
        g_z = -central * (1.0 + j2 * (3.0 - tilt)) * z
        g = to_body(q, (g_z * cos_lat - g_rho * sin_lat, 0.0, -(g_rho * cos_lat + g_z * sin_lat)))
        ned = to_ned(q, v)
        lat_rate, lon_rate = ned[0] / (meridian + h), ned[1] / ((vertical + h) * cos_lat)
        frame = to_body(q, (lon_rate * cos_lat, -lat_rate, -lon_rate * sin_lat))
        s = tuple(rate[i] - turn[i] - frame[i] for i in range(3))
        carried = cross(tuple(rate[i] + turn[i] for i in range(3)), v)
        m = x["mass"]
        return {
            "altitude": -ned[2],
            "longitude": lon_rate,
            "latitude": lat_rate,
            "u": (fx + tx) / m + g[0] - carried[0],
            "v": fy / m + g[1] - carried[1],
            "w": (fz + tz) / m + g[2] - carried[2],
            "q0": -0.5 * (q[1] * s[0] + q[2] * s[1] + q[3] * s[2]),
            "q1": 0.5 * (q[0] * s[0] + q[2] * s[2] - q[3] * s[1]),
            "q2": 0.5 * (q[0] * s[1] + q[3] * s[0] - q[1] * s[2]),
            "q3": 0.5 * (q[0] * s[2] + q[1] * s[1] - q[2] * s[0]),
            "roll_rate": (izz * n[0] - i13 * n[2]) * inverse,
            "pitch_rate": n[1] / iyy,
            "yaw_rate": (ixx * n[2] - i13 * n[0]) * inverse,
            "mass": -c.burns_fuel
            * nominal_thrust
            / (c.standard_gravity * isp * p("propulsion.specific_impulse")),
        }

    return derivative


def make_lqr(plan: FlightPlan) -> Callable[[State, Scalar, Scalar], tuple]:
    """The law: commands of aileron, rudder, elevator and engine from a state and a tick's reference and gains."""
    c, earth, settings = plan.vehicle.constants, plan.earth, plan.settings

    def wrap(angle: Scalar) -> Scalar:
        return angle - 2.0 * np.pi * jnp.round(angle / (2.0 * np.pi))

    def lqr(x: State, r: Scalar, k: Scalar) -> tuple:
        q, v = attitude_of(x), (x["u"], x["v"], x["w"])
        north, east, down = to_ned(q, v)
        speed, sin_a, cos_a, sin_b, cos_b, alpha, beta = flow_of(v)
        d = to_body(q, (0.0, 0.0, 1.0))
        bank = jnp.arctan2(
            -cos_a * sin_b * d[0] + cos_b * d[1] - sin_a * sin_b * d[2],
            -sin_a * d[0] + cos_a * d[2],
        )
        errors = (
            x["altitude"] - r[ref.ALTITUDE],
            jnp.arctan2(-down, jnp.sqrt(north * north + east * east)) - r[ref.FLIGHT_PATH_ANGLE],
            wrap(jnp.arctan2(east, north) - r[ref.HEADING]),
            speed - r[ref.SPEED],
        )
        u = [sum(k[ref.LQR_GUIDANCE + 4 * i + j] * errors[j] for j in range(4)) for i in range(3)]
        alpha_cmd = jnp.clip(r[ref.ANGLE_OF_ATTACK] - u[0], settings[0], settings[1])
        bank_cmd = jnp.clip(r[ref.BANK] - u[1], -settings[2], settings[2])
        eta_cmd = jnp.clip(
            r[ref.EQUIVALENCE_RATIO] - u[2], c.equivalence_ratio_min, c.equivalence_ratio_max
        )
        radius = earth.equatorial_radius + x["altitude"]
        turn = earth.gravitational_parameter / (radius * radius * speed) * jnp.sin(bank_cmd)
        lateral = (
            wrap(bank - bank_cmd),
            beta,
            x["roll_rate"] + turn * jnp.sin(alpha_cmd),
            x["yaw_rate"] - turn * jnp.cos(alpha_cmd),
        )
        pitch_rate = x["pitch_rate"] - turn * jnp.tan(bank_cmd)
        e, n = ref.LQR_ELEVATOR, ref.LQR_LATERAL
        elevator = r[ref.ELEVATOR] - (k[e] * (alpha - alpha_cmd) + k[e + 1] * pitch_rate)
        aileron, rudder = (-sum(k[n + 4 * i + j] * lateral[j] for j in range(4)) for i in range(2))
        limit = c.surface_limit
        return (
            *(jnp.clip(command, -limit, limit) for command in (aileron, rudder, elevator)),
            eta_cmd,
        )

    return lqr
