"""How far a navigation filter's estimates are from the truth, measured by its own covariance: NEES.

The mean of each over many flights is 3 if the filter is consistent; 2.67 to 3.35 with 200 flights.
"""

from abhv_mc.extend import channel, sincos, solve, sqrt

RADIUS, E2 = 6378137.0, 6.69437999014e-3


def normalized(error, numbers):
    """Squared error relative to a covariance given by rows."""
    n = numbers
    weighed = solve(((n[0], n[1], n[2]), (n[3], n[4], n[5]), (n[6], n[7], n[8])), error)
    return error[0] * weighed[0] + error[1] * weighed[1] + error[2] * weighed[2]


@channel(unit="-")
def position_nees(actual, memory):
    """Squared position error relative to its covariance."""
    sine, cosine = sincos(memory.latitude)
    w2 = 1.0 - E2 * sine * sine
    normal = RADIUS / sqrt(w2)
    error = (
        (actual.latitude - memory.latitude) * (normal * (1.0 - E2) / w2 + memory.altitude),
        (actual.longitude - memory.longitude) * (normal + memory.altitude) * cosine,
        memory.altitude - actual.altitude,
    )
    return normalized(error, memory[22:31])


@channel(unit="-")
def velocity_nees(actual, memory):
    """Squared velocity error relative to its covariance."""
    sin_g, cos_g = sincos(actual.flight_path_angle)
    sin_c, cos_c = sincos(actual.heading)
    error = (
        actual.speed * cos_g * cos_c - memory.north,
        actual.speed * cos_g * sin_c - memory.east,
        -actual.speed * sin_g - memory.down,
    )
    return normalized(error, memory[67:76])


@channel(unit="-")
def attitude_nees(actual, memory):
    """Squared attitude error relative to its covariance."""
    a, b, c, d = actual.q0, actual.q1, actual.q2, actual.q3
    w, x, y, z = memory.q0, memory.q1, memory.q2, memory.q3
    # Truth times the conjugate of the estimate: half the rotation between them.
    sign = 2.0 if a * w + b * x + c * y + d * z > 0.0 else -2.0
    error = (
        sign * (b * w - a * x - c * z + d * y),
        sign * (c * w - a * y - d * x + b * z),
        sign * (d * w - a * z - b * y + c * x),
    )
    return normalized(error, memory[103:112])
